"""A loop that rings, from a narrow peak that position and effort share and the reference does not have.

Gains that are too high for the delay of a loop make it oscillate where its phase reaches -180 degrees: at one
frequency, far above the motion, with position and effort coherent. Noise of an encoder has no peak; what follows a
reference that jitters is coherent with it, and does not count; what depends on the position, such as cogging, moves
with the velocity and comes and goes; sticking makes a slow cycle, below the band.
"""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.loop import Loop
from pidtsm_studies.diagnosis.verdict import Curve, Plot, State, Verdict

_LOWEST, _HIGHEST = 3.0, 0.3
"""Hz, and share of the rate: where a loop rings."""
_WIDTH = 0.25
"""Relative half-width of a peak, in which its power is counted."""
_NARROW = 0.5
"""Share of the band's power that is in a peak."""
_LARGEST = 0.06
"""rad/s or m/s RMS that needs no mention."""
_COHERENT = 0.5
_FASTEST_MOTION = 10.0
"""Hz; cogging of a joint that moves is slower."""
_SPREAD = 1.3
"""Ratio of the edges of a band to its middle."""
_SELDOM, _STEADY = 25.0, 0.35
"""Percentile of the oscillation's size, and least share that it has of the size at the opposite percentile."""
_ABOVE_NOISE = 30.0
"""Ratio of the peak's density to that of the encoder's noise."""


def ringing(loop: Loop) -> Verdict:
    """Find the joint with the strongest peak."""
    speed, frequency, is_peak = peaks(loop)
    rings = [int(j) for j in np.argsort(-speed) if is_peak[j]]
    worst = rings[0] if rings else int(speed.argmax())
    unit = loop.observed.units[worst].position
    text = (
        f"{loop.joints[worst]} rings at {frequency[worst]:.3g} Hz with {speed[worst]:.2g} {unit}/s"
        if rings
        else "nothing rings"
    )
    return Verdict(
        Cause.RINGING,
        State.FOUND if rings else State.FINE,
        text,
        tuple(loop.joints[j] for j in rings),
        float(speed[worst]),
        _LARGEST,
        f"{unit}/s",
        "lower the bandwidth of this joint by a third (estimator.bandwidth, law.kp, law.kd), or ./pidtsm gains, which "
        "knows delay and resolution"
        if rings
        else "",
        (_plot(loop, worst),),
    )


def _plot(loop: Loop, j: int) -> Plot:
    """Spectrum of the velocity of joint j."""
    spectrum, unit = loop.spectrum, loop.observed.units[j].position
    band = spectrum.frequency > 0.5
    f = spectrum.frequency[band]
    curve = Curve("velocity", f, 2.0 * np.pi * f * np.sqrt(spectrum.position[band, j]))
    return Plot(f"Spectrum of the velocity of {loop.joints[j]}", "frequency [Hz]", f"{unit}/s/√Hz", (curve,), True)


def peaks(loop: Loop) -> tuple[Array, Array, Array]:
    """Of the largest peak of each joint: velocity (RMS), frequency (Hz), and whether it is one of a loop that rings.

    Each has shape (joints,).
    """
    spectrum, f = loop.spectrum, loop.spectrum.frequency
    band = (f > _LOWEST) & (f < _HIGHEST * loop.rate)
    step = float(f[1] - f[0])
    noise = np.median(spectrum.position[f > 0.25 * loop.rate], axis=0)
    omega = (2.0 * np.pi * f[:, np.newaxis]) ** 2
    power = omega * np.maximum(spectrum.position * (1.0 - spectrum.following) - noise, 0.0)
    speed, frequency, is_peak = (np.zeros(len(loop.joints)) for _ in range(3))
    for j in range(len(loop.joints)):
        top = int(np.argmax(np.where(band, power[:, j], 0.0)))
        near = band & (np.abs(f - f[top]) <= max(_WIDTH * f[top], 1.5 * step))
        total = power[band, j].sum()
        speed[j], frequency[j] = np.sqrt(power[near, j].sum() * step), f[top]
        is_peak[j] = (
            speed[j] > _LARGEST
            and power[near, j].sum() > _NARROW * total
            and spectrum.coherence[top, j] > _COHERENT
            and spectrum.position[top, j] > _ABOVE_NOISE * noise[j]
            and (f[top] > _FASTEST_MOTION or _lasts(loop, j, float(f[top])))
        )
    return speed, frequency, is_peak.astype(bool)


def _lasts(loop: Loop, j: int, frequency: float) -> bool:
    """Whether the oscillation of joint j at a frequency (Hz) is there most of the time.

    What follows from the velocity of the motion, such as cogging, comes and goes.
    """
    band = loop.smooth(loop.rough(loop.position[:, j : j + 1], frequency / _SPREAD), frequency * _SPREAD)[:, 0]
    size = loop.smooth(band[:, np.newaxis] ** 2, 0.25 * frequency)[:, 0]
    low, middle = np.percentile(size, (_SELDOM, 100.0 - _SELDOM))
    return bool(low > _STEADY**2 * middle)
