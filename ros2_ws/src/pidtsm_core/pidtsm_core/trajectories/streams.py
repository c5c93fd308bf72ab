"""Streams of targets, from teleoperation or a learned policy, filtered to a motion within the limits of the arm."""

import math
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.messages.arrivals import Arrivals, Stamp
from pidtsm_core.timing import NANOSECONDS, seconds
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limited_tracking import track
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.regular_times import RegularTimes
from pidtsm_core.trajectories.splice import unwind
from pidtsm_core.trajectories.target_curve import FADE, evaluate, velocities

LONGEST_CHUNK = 1000
"""Largest number of points of a chunk."""
FARTHEST = 10.0
"""Time after which a chunk may start at the latest, s."""
_OTHER_CLOCK = "; its stamp must be on the clock of the joint states (use_sim_time of the sender)"
BLEND = 0.2
"""Time in which a chunk takes over from the one before, s."""
SILENCE, _PATIENCE = 0.1, 0.05
"""A stream has ended when no target has come for the first time, or for the second more than its delay, s."""

_TICK = 1e-3
"""Longest tick of the motion, s."""
_ROUNDING = 1e-7
"""Times that differ less are the same, s."""
_MARGIN = 200.0
"""Margin of position limits, in jerk times tick^3; of 2,000 random streams, the farthest passes its bound by 110."""
_MOST_TICKS = 1000
"""Longest gap; after a longer one the motion lags, because nothing is followed for so long."""
_CLOSEST = 2e-3
"""Points of a chunk that come sooner than this after it takes over are left out, s."""
_SLEW = 0.05
"""Largest rate at which the delay changes."""
_QUANTILE = 3.0
"""The delay suffices for so many times as many targets as come too late for it."""


class StreamStatistics(NamedTuple):
    """How a stream arrives.

    Attributes:
        rate: targets per second, of the median period; 0: unknown.
        delay: time by which the motion is behind the targets whose messages take least time, s.
        age: time since the last target, s.
        received: number of targets and chunks used.
        missing: number of targets missing between them.
        refused: number of stamps that were late, repeated or ahead.
        clipped: number of targets beyond a position limit.
    """

    rate: float
    delay: float
    age: float
    received: int
    missing: int
    refused: int
    clipped: int


class StreamFilter:
    """A motion that follows targets: its acceleration is continuous, and it keeps the limits of the arm.

    Targets may come at 10 to 500 Hz, with jitter, and some may be missing. A smooth curve through them is played back
    with a delay for which three of four targets come in time: about one period and most of the jitter. It does not
    overshoot the targets. After the last one it comes to rest within `FADE`. The motion tracks the curve, see `track`;
    from anywhere else it approaches it, as fast as the limits allow.

    `receive` and `receive_chunk` change nothing if they raise an error; the first of them comes before `begin`.

    Attributes:
        running: whether the motion has begun and not ended.
    """

    def __init__(self, limits: MotionLimits) -> None:
        """Args: limits: of the arm."""
        self._limits = limits
        # Ticks are even steps, so positions are limited with a margin.
        margin = np.minimum(_MARGIN * limits.jerk * _TICK**3, 0.25 * (limits.upper - limits.lower))
        lower, upper = limits.lower + margin, limits.upper - margin
        self._bounds = np.array([lower, upper, limits.planned_velocity, limits.acceleration, limits.jerk])
        joints = len(limits.joints)
        self._state, self._target = np.zeros((3, joints)), np.zeros((3, joints))
        self._arrivals, self._regular = Arrivals(), RegularTimes()
        self._epoch = self._arrived = 0  # ns
        self._start = self._time = 0.0  # s
        self._received = self._missing = self._refused = self._clipped = 0
        self._delay = self._wanted_delay = 0.0  # s from the clock of the stamps, whatever that is
        self._delay_known = False
        self.running = False
        self._forget()
        _advance(self._times, self._knots, np.array([0.0, _TICK, _TICK]), self._bounds, self._state, self._target)

    def _forget(self) -> None:
        """Drop all targets."""
        joints = len(self._limits.joints)
        self._chunked = False
        self._times, self._knots = np.zeros(1), np.zeros((1, 2, joints))
        self._empty = True

    def begin(self, now: int, present: Array) -> None:
        """Begin to move from this state.

        Args:
            now: ns; time 0 of `evaluate`.
            present: q, q', q'', shape (3, joints), rad, rad/s, rad/s^2.
        """
        self._start, self._time = seconds(now - self._epoch), 0.0
        self._state[:] = present
        self.running = True

    def end(self) -> None:
        """Forget the targets; another motion takes over."""
        self.running = False
        self._forget()

    def freeze(self) -> None:
        """Keep the delay, so that `evaluate` foresees the motion exactly if no target comes."""
        self._wanted_delay = self._delay

    def advance(self, now: int) -> None:
        """Move on to `now`, ns; call it for every sample."""
        t = seconds(now - self._epoch) - self._start
        elapsed = t - self._time
        if elapsed > _ROUNDING:
            change = self._wanted_delay - self._delay
            slewed = self._delay + math.copysign(min(abs(change), _SLEW * elapsed), change)
            self._move(t, slewed, self._state)
            self._time, self._delay = t, slewed

    def evaluate(self, t: float, desired: Array) -> None:
        """Write q_d, q_d', q_d'' at t (s since `begin`) to desired, shape (3, joints).

        If t is later than the last call of `advance`, that is where the motion will be if no target comes until then.
        """
        desired[:] = self._state
        if t > self._time + _ROUNDING:
            self._move(t, self._delay, desired)

    def _move(self, t: float, delay: float, state: Array) -> None:
        """Move a state on until t, when the curve is played back with this delay, s."""
        begin, end = self._start + self._time - self._delay, self._start + t - delay
        span = np.array([begin, end, t - self._time])
        _advance(self._times, self._knots, span, self._bounds, state, self._target)

    def targets(self, otherwise: Array) -> Array:
        """The last target, shape (joints,), rad; `otherwise` if there is none. Its joints hold unless named again."""
        return (otherwise if self._empty else self._knots[-1, 0]).copy()

    def ended(self, now: int) -> bool:
        """Whether the stream has stopped by the time `now`, ns."""
        if self._chunked:
            return seconds(now - self._epoch) > self._times[-1] + FADE
        return seconds(now - self._arrived) > max(SILENCE, self._latency + _PATIENCE)

    @property
    def _latency(self) -> float:
        """Delay of the motion behind targets whose messages take least time, s."""
        return 0.0 if self._chunked else self._wanted_delay + seconds(self._arrivals.lead)

    def statistics(self, now: int) -> StreamStatistics:
        """How the stream arrives; `now`: ns."""
        period = self._arrivals.period
        return StreamStatistics(
            rate=NANOSECONDS / period if period else 0.0,
            delay=self._latency,
            age=seconds(now - self._arrived),
            received=self._received,
            missing=self._missing,
            refused=self._refused,
            clipped=self._clipped,
        )

    def receive(self, now: int, stamp: int, position: Array, velocity: Array | None = None) -> str:
        """Add a target.

        Args:
            now: time of its arrival on the clock of the motion, ns.
            stamp: time of the target, ns, on any clock; 0: unknown, see `RegularTimes`.
            position: shape (joints,), rad or m; clipped to the limits.
            velocity: rad/s or m/s; None: that of the targets.

        Returns:
            A warning; empty if there is none.

        Raises:
            TrajectoryError: a number is not finite, or the stamp is late, repeated or ahead (see `Arrivals`).
        """
        _check_finite("position", position)
        if velocity is not None:
            _check_finite("velocity", velocity)
        judged = self._arrivals.judge(stamp, now) if stamp else Stamp.NEW
        if not judged.usable:
            self._refused += 1
            raise TrajectoryError(judged.explanation)
        stamp = stamp or max(self._regular.stamp(now), self._arrivals.last + 1)
        last, period = self._arrivals.last, self._arrivals.period
        self._arrivals.take(judged, stamp, now)
        if self._chunked or judged is Stamp.RESTARTED:
            self._forget()
            self._delay_known = False
        if not self._received:
            self._epoch = now
        if not self._empty and period:
            self._missing += max(round((stamp - last) / period) - 1, 0)
        time = seconds(stamp - self._epoch)
        position, warning = self._possible(position[None])
        self._append(time, seconds(now - self._epoch), position[0], velocity)
        self._arrived = now
        self._received += 1
        return warning

    def _append(self, time: float, now: float, position: Array, velocity: Array | None) -> None:
        """Add a knot to the curve, and adapt the delay."""
        bound = self._limits.planned_velocity
        if self._empty:
            if not self._delay_known:
                self._delay = self._wanted_delay = now - time
            self._times, self._knots = np.array([time]), np.stack([position, np.zeros_like(position)])[None]
            self._empty = False
        else:
            # The delay for which the last target would not have been the last for any time.
            needed = now - float(self._times[-1])
            if not self._delay_known:
                self._delay = self._wanted_delay = needed
                self._delay_known = True
            else:
                step = seconds(self._arrivals.period) / 32.0
                self._wanted_delay += _QUANTILE * step if needed > self._wanted_delay else -step
            kept = max(int(np.searchsorted(self._times, now - self._delay, side="right")) - 1, 0)
            kept = min(kept, max(len(self._times) - 2, 0))
            knot = np.stack([position, np.zeros_like(position)])[None]
            self._times, self._knots = np.append(self._times[kept:], time), np.concatenate([self._knots[kept:], knot])
            near = slice(-3, None)
            if velocity is None and len(self._times) > 2:
                rates = velocities(self._times[near], self._knots[near, 0], self._limits.acceleration)
                self._knots[-2:, 1] = rates[-2:]
        if velocity is not None:
            self._knots[-1, 1] = np.clip(velocity, -bound, bound)

    def receive_chunk(self, now: int, start: int, times: Array, positions: Array) -> str:
        """Follow a chunk of targets, which takes over at its start, and within `BLEND` entirely.

        Args:
            now: time of its arrival, ns.
            start: time of the chunk on the same clock, ns; 0: `now`. Points that are over are skipped.
            times: of the points, s since `start`, increasing, shape (n,).
            positions: shape (n, joints), rad or m; clipped to the limits.

        Returns:
            A warning; empty if there is none.

        Raises:
            TrajectoryError: a number is not finite, the times do not increase, there are more than `LONGEST_CHUNK`
                points, all are over, or it starts later than `FARTHEST`.
        """
        if len(times) > LONGEST_CHUNK:
            raise TrajectoryError(f"it has {len(times)} points; at most {LONGEST_CHUNK} are allowed")
        _check_finite("position", positions)
        if not len(times) or not np.isfinite(times).all() or times[0] < 0.0 or np.any(np.diff(times) <= 0.0):
            raise TrajectoryError("time_from_start must begin at 0 or later, and increase from point to point")
        start = start or now
        late = seconds(now - start)
        clock = _OTHER_CLOCK if abs(late) > FARTHEST else ""
        if start + int(times[-1] * NANOSECONDS) <= now:
            raise TrajectoryError(f"it is over: it started {late:g} s ago and takes {times[-1]:g} s{clock}")
        if late < -FARTHEST:
            raise TrajectoryError(f"it starts {-late:g} s from now; at most {FARTHEST:g} s is allowed{clock}")
        if not self._received:
            self._epoch = now
        positions, warning = self._possible(positions)
        begin = seconds(max(start, now) - self._epoch)
        self._splice(seconds(now - self._epoch), begin, seconds(start - self._epoch) + times, positions)
        self._arrived = now
        self._received += 1
        return warning

    def _splice(self, now: float, begin: float, times: Array, positions: Array) -> None:
        """Change to other targets at `begin` (s), `now` or later."""
        if self._empty:
            passed = max(int(np.searchsorted(times, begin, side="right")) - 1, 0)
            times, positions = times[passed:], positions[passed:]
            rates = velocities(times, positions, self._limits.acceleration)
        else:
            old_times, knots = self._times + (0.0 if self._chunked else self._delay), self._knots
            later = times > begin + _CLOSEST
            times, positions = times[later], positions[later].copy()
            for row, time in enumerate(times):
                evaluate(old_times, knots, time, self._target)
                share = min((time - begin) / BLEND, 1.0)
                share *= share * (3.0 - 2.0 * share)
                positions[row] = self._target[0] + share * (positions[row] - self._target[0])
            evaluate(old_times, knots, begin, self._target)
            first = max(int(np.searchsorted(old_times, now, side="right")) - 1, 0)
            kept = slice(first, int(np.searchsorted(old_times, begin - _CLOSEST)))
            before = len(old_times[kept]) + 1
            times = np.concatenate([old_times[kept], [begin], times])
            positions = np.concatenate([knots[kept, 0], self._target[:1], positions])
            rates = velocities(times, positions, self._limits.acceleration)
            rates[:before] = np.concatenate([knots[kept, 1], self._target[1:2]])
        self._times, self._knots = times, np.ascontiguousarray(np.stack([positions, rates], axis=1))
        self._empty, self._chunked = False, True
        self._delay = self._wanted_delay = 0.0

    def _possible(self, positions: Array) -> tuple[Array, str]:
        """Positions at the nearest turn and within the limits, and a warning if they were not within."""
        near = self.targets(self._state[0] if self.running else positions[0])
        unwound = unwind(positions[:, None], near, self._limits)[:, 0]
        within = np.clip(unwound, self._bounds[0], self._bounds[1])
        beyond = np.abs(np.clip(unwound, self._limits.lower, self._limits.upper) - unwound).max(axis=0)
        if not beyond.any():
            return within, ""
        self._clipped += int((within != unwound).any(axis=1).sum())
        j = int(np.argmax(beyond))
        low, high = self._limits.lower[j], self._limits.upper[j]
        return within, f"{self._limits.joints[j]} is clipped to its limits, {low:g} to {high:g}"


def _check_finite(what: str, values: Array) -> None:
    if not np.isfinite(values).all():
        raise TrajectoryError(f"{what} is not finite")


@njit
def _advance(times: Array, knots: Array, span: Array, bounds: Array, state: Array, target: Array) -> None:
    """Advance `state`; `span`: times of the curve at begin and end, and the time that passes, s."""
    begin, end, elapsed = span[0], span[1], span[2]
    ticks = min(max(math.ceil(elapsed / _TICK - 1e-6), 1), _MOST_TICKS)
    dt = min(elapsed / ticks, _TICK)
    for k in range(ticks):
        evaluate(times, knots, begin + (end - begin) * (k + 1) / ticks, target)
        track(state, target, bounds, dt)
