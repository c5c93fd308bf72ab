"""Motions of the steps: desired positions over time with their derivatives."""

from dataclasses import dataclass

import numpy as np

from pidtsm_core.arrays import Array

STEP = 0.002
"""Time between the states of a motion, s."""
_PEAK_VELOCITY, _PEAK_ACCELERATION = 1.875, 5.7735
"""Of a quintic from rest to rest over distance 1 in time 1."""
_RAMP, _SHAKEN_FADE = 0.25, 0.15
"""s to reach a constant velocity, and to fade in and out what shakes a joint then."""
_LEAST = 0.2
"""Shortest duration of a motion between two postures, s."""


@dataclass(frozen=True)
class Motion:
    """A motion from rest to rest.

    Attributes:
        states: q, q', q'' every `STEP`, shape (3, samples, joints), rad or m, per s, per s^2.
        shaking: torques on top of those of the controller, likewise, shape (samples, joints), N m or N; None: none.
    """

    states: Array
    shaking: Array | None = None

    @property
    def duration(self) -> float:
        """s."""
        return STEP * (self.states.shape[1] - 1)

    @property
    def begin(self) -> Array:
        """The first posture, shape (joints,)."""
        return self.states[0, 0]

    @property
    def end(self) -> Array:
        """The last posture, shape (joints,)."""
        return self.states[0, -1]

    @property
    def travel(self) -> Array:
        """Farthest distance of each joint from its first position, shape (joints,)."""
        return np.asarray(np.abs(self.states[0] - self.begin).max(axis=0))

    def at(self, time: float, desired: Array) -> None:
        """Write q, q', q'' at a time (s) to `desired`, shape (3, joints); beyond the end the arm rests there."""
        place = min(max(time / STEP, 0.0), self.states.shape[1] - 1.0)
        k = int(place)
        later = STEP * (place - k)
        q, dq, ddq = self.states[:, k]
        desired[0] = q + later * (dq + 0.5 * later * ddq)
        desired[1] = dq + later * ddq
        desired[2] = ddq

    def shaking_at(self, time: float) -> Array | None:
        """Torques on top of those of the controller at a time (s), shape (joints,), N m or N; None: there are none."""
        if self.shaking is None:
            return None
        place = min(max(time / STEP, 0.0), self.shaking.shape[0] - 1.0)
        k, share = int(place), place % 1.0
        return np.asarray((1.0 - share) * self.shaking[k] + share * self.shaking[min(k + 1, len(self.shaking) - 1)])


def _times(duration: float) -> Array:
    return np.asarray(STEP * np.arange(max(1, round(duration / STEP)) + 1), dtype=np.float64)


def rest(posture: Array, duration: float) -> Motion:
    """Stay in a posture, shape (joints,), for a time, s."""
    states = np.zeros((3, _times(duration).size, posture.size))
    states[0] = posture
    return Motion(states)


def straight(start: Array, end: Array, velocity: Array, acceleration: Array) -> Motion:
    """A quintic between two postures that keeps limits, each of shape (joints,)."""
    distance = np.abs(end - start)
    with np.errstate(divide="ignore", invalid="ignore"):
        slow = np.max(np.nan_to_num(_PEAK_VELOCITY * distance / velocity))
        gentle = np.sqrt(np.max(np.nan_to_num(_PEAK_ACCELERATION * distance / acceleration)))
    duration = max(_LEAST, float(slow), float(gentle))
    time = _times(duration)
    duration = float(time[-1])
    x = (time / duration)[:, np.newaxis]
    shapes = (
        x**3 * (10.0 - 15.0 * x + 6.0 * x**2),
        30.0 * x**2 * (1.0 - x) ** 2 / duration,
        60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / duration**2,
    )
    states = np.stack([shape * (end - start) for shape in shapes])
    states[0] += start
    return Motion(states)


def joined(*motions: Motion) -> Motion:
    """One motion after the other; each begins where the one before ends."""
    first, *others = motions
    states = np.concatenate([first.states, *(each.states[:, 1:] for each in others)], axis=1)
    if all(each.shaking is None for each in motions):
        return Motion(states)
    shaking = [np.zeros_like(each.states[0]) if each.shaking is None else each.shaking for each in motions]
    return Motion(states, np.concatenate([shaking[0], *(each[1:] for each in shaking[1:])]))


def periodic(middle: Array, series: Array, frequency: float, duration: float, fade: float = 1.0) -> Motion:
    """Sines about a posture that fade in and out, so that the motion begins and ends there at rest.

    Args:
        middle: shape (joints,).
        series: amplitudes of the harmonics, shape (harmonics, joints).
        frequency: of the first, Hz.
        duration: s.
        fade: time of fading in, and out, s.
    """
    time = _times(duration)
    angles = 2.0 * np.pi * frequency * np.outer(time, np.arange(1, len(series) + 1))
    return _faded(middle, np.sin(angles) @ series, time, fade)


def chirp(middle: Array, amplitude: Array, low: float, high: float, duration: float, fade: float = 0.3) -> Motion:
    """A sine about a posture whose frequency rises; where it is faster its amplitude is smaller, like 1 / f^2.

    Args:
        middle: shape (joints,).
        amplitude: at the lowest frequency, shape (joints,).
        low: frequency at the begin, Hz.
        high: at the end.
        duration: s.
        fade: time of fading in, and out, s.
    """
    time = _times(duration)
    rate = (high / low) ** (1.0 / duration)
    phase = 2.0 * np.pi * low * (rate**time - 1.0) / np.log(rate)
    size = (rate**time) ** -2.0
    return _faded(middle, np.outer(size * np.sin(phase), amplitude), time, fade)


def shaken(
    begin: Array, end: Array, speed: float, torque: float, band: tuple[float, float], falls: float
) -> tuple[Motion, tuple[float, float]]:
    """One joint goes from one posture to another with a constant velocity, and is shaken meanwhile.

    Args:
        begin: shape (joints,).
        end: another position of one joint, likewise.
        speed: rad/s.
        torque: that shakes the joint, N m.
        band: the frequency rises from the first to the second of these, Hz.
        falls: above this frequency, Hz, the torque falls like 1 / f.

    Returns:
        The motion, and the times between which the joint is shaken, s.
    """
    j = int(np.argmax(np.abs(end - begin)))
    way = abs(float(end[j] - begin[j]))
    time = _times(way / speed + _RAMP)
    inner = (_RAMP, float(time[-1]) - _RAMP)
    x = np.clip(np.minimum(time, time[-1] - time) / _RAMP, 0.0, 1.0)
    velocity = 0.5 * (1.0 - np.cos(np.pi * x))
    position = STEP * np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]))])
    scale = (end - begin) / position[-1]
    states = np.stack([np.outer(each, scale) for each in (position, velocity, np.gradient(velocity, STEP))])
    states[0] += begin
    states[1:, [0, -1]] = 0.0

    duration, (low, high) = inner[1] - inner[0], band
    since = np.clip(time - inner[0], 0.0, duration)
    rate = (high / low) ** (1.0 / duration)
    frequency = low * rate**since
    phase = 2.0 * np.pi * low * (rate**since - 1.0) / np.log(rate)
    fade = np.clip(np.minimum(time - inner[0], inner[1] - time) / _SHAKEN_FADE, 0.0, 1.0)
    shaking = np.zeros_like(states[0])
    shaking[:, j] = torque * fade * np.minimum(1.0, falls / frequency) * np.sin(phase)
    return Motion(states, shaking), inner


def _faded(middle: Array, swing: Array, time: Array, fade: float) -> Motion:
    """A motion about a posture, faded in and out; the derivatives are differences of the positions."""
    x = np.clip(np.minimum(time, time[-1] - time) / fade, 0.0, 1.0)
    swing = swing * (x**3 * (10.0 - 15.0 * x + 6.0 * x**2))[:, np.newaxis]
    velocity = np.gradient(swing, STEP, axis=0, edge_order=2)
    states = np.stack([middle + swing, velocity, np.gradient(velocity, STEP, axis=0, edge_order=2)])
    states[1:, [0, -1]] = 0.0
    return Motion(states)


def sweeps(middle: Array, reach: Array, speeds: tuple[float, ...], acceleration: float) -> Motion:
    """All joints together from one end of their reach to the other and back, with constant velocities in between.

    Args:
        middle: shape (joints,).
        reach: half of the way, shape (joints,), rad or m; 0: the joint stays.
        speeds: of the joint with the longest reach, rad/s; one sweep there and back for each.
        acceleration: of this joint, rad/s^2.
    """
    longest = float(reach.max())
    way, parts = 2.0 * longest, []
    for speed in speeds:
        ramp = speed / acceleration
        cruise = max(0.0, way / speed - ramp)
        time = _times(2.0 * ramp + cruise)
        # A raised cosine keeps the acceleration continuous, unlike a trapezoid.
        x = np.clip(np.minimum(time, time[-1] - time) / ramp, 0.0, 1.0)
        velocity = speed * 0.5 * (1.0 - np.cos(np.pi * x))
        position = STEP * np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]))])
        velocity *= way / position[-1]
        position *= way / position[-1]
        states = np.stack([position - longest, velocity, np.gradient(velocity, STEP)])
        states[1:, [0, -1]] = 0.0
        pause = np.zeros((3, round(0.3 / STEP)))
        pause[0] = longest
        parts += [states, pause, -states, -pause]
    one = np.concatenate(parts, axis=1)
    whole = one[:, :, np.newaxis] * (reach / longest)
    whole[0] += middle
    return Motion(whole)
