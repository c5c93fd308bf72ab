"""Motions that are commanded as points while another motion is in progress."""

from typing import Protocol

import numpy as np

from pidtsm_core.parameters import Array
from pidtsm_core.polynomials import add_quintic, quintic
from pidtsm_core.references.piecewise import evaluate, piecewise
from pidtsm_core.timing import seconds

STOP = 0.5
"""Time in which a cancelled motion comes to rest, s."""

_AT_REST = 1e-6  # rad/s
_SHORTEST_APPROACH = 1.0  # s
_APPROACH_VELOCITY = 0.5  # rad/s, mean velocity of the joint that moves farthest


class TrajectoryError(ValueError):
    """A trajectory cannot be followed; the message gives the reason."""


class Motion(Protocol):
    """A desired motion."""

    def evaluate(self, t: float, desired: Array) -> None:
        """Write q_d, q_d', q_d'' at t (s) to desired, shape (3, joints), rad, rad/s, rad/s^2."""


class PiecewiseMotion:
    """A piecewise polynomial motion, see `piecewise`."""

    def __init__(self, parameters: Array) -> None:
        """Args: parameters: as `piecewise` returns them."""
        self._parameters = parameters

    def evaluate(self, t: float, desired: Array) -> None:
        """See `Motion.evaluate`."""
        evaluate(t, self._parameters, desired)


class Rest:
    """A constant position."""

    def __init__(self, position: Array) -> None:
        """Args: position: shape (joints,), rad."""
        self._position = position.copy()

    def evaluate(self, t: float, desired: Array) -> None:
        """See `Motion.evaluate`."""
        desired[0] = self._position
        desired[1:] = 0.0


class Approach:
    """A motion and the approach to it: a quintic reduces the difference from the present state to zero."""

    def __init__(self, motion: Motion, present: Array) -> None:
        """Args: motion: the motion, approached from its start; present: q, q', q'' at time 0, shape (3, joints)."""
        self._motion = motion
        difference = np.zeros_like(present)
        motion.evaluate(0.0, difference)
        np.subtract(present, difference, out=difference)
        self._duration = max(_SHORTEST_APPROACH, float(np.abs(difference[0]).max()) / _APPROACH_VELOCITY)
        self._way = np.zeros((6, present.shape[1]))
        quintic(difference, np.zeros_like(present), self._duration, self._way)

    def evaluate(self, t: float, desired: Array) -> None:
        """See `Motion.evaluate`."""
        self._motion.evaluate(t, desired)
        if t < self._duration:
            add_quintic(self._way, self._duration, t, desired)


def plan(times: Array, points: Array, elapsed: float, present: Array, tolerance: float) -> PiecewiseMotion:
    """Plan a motion through points: linear between positions, cubic with velocities, quintic with accelerations.

    It starts with the position and velocity of the present motion, and a quintic also with its acceleration. The
    segment to the first point is therefore at least a cubic.

    Args:
        times: of the points, s from the start of the trajectory, shape (n,).
        points: positions, and velocities and accelerations where given, shape (n, 1 to 3, joints), rad, rad/s, rad/s^2.
        elapsed: s since the start; points up to this time are skipped.
        present: q, q', q'' at that time, shape (3, joints).
        tolerance: largest distance of the last skipped point from the present position, rad.

    Raises:
        TrajectoryError: the times do not increase, or the motion is over, does not end at rest, or starts too far away.
    """
    if times[0] < 0.0 or np.any(np.diff(times) <= 0.0):
        raise TrajectoryError("time_from_start must begin at 0 or later, and increase from point to point")
    if times[-1] <= elapsed:
        raise TrajectoryError(
            f"it is over: it started {elapsed:g} s ago and takes {times[-1]:g} s"
            if elapsed > 0.0
            else "it takes no time: a point later than its start is needed"
        )
    _, given, joints = points.shape
    if given > 1 and np.abs(points[-1, 1]).max() > _AT_REST:
        raise TrajectoryError(f"it must end at rest; the last point has the velocities {points[-1, 1].tolist()}")
    passed = int(np.searchsorted(times, elapsed, side="right"))
    if passed and (distance := np.abs(points[passed - 1, 0] - present[0]).max()) > tolerance:
        raise TrajectoryError(
            f"point {passed} is due now, and {distance:.3g} from the present reference "
            f"{present[0].tolist()}; at most {tolerance:g} is allowed (start_tolerance)"
        )

    times = np.concatenate([[elapsed], times[passed:]])
    states = np.zeros((times.size, 3, joints))
    states[0] = present
    states[1:, :given] = points[passed:]
    starts, ends = states[:-1].copy(), states[1:].copy()
    durations = np.diff(times)[:, None]
    if given == 1:
        slopes = np.diff(states[:, 0], axis=0) / durations
        starts[1:, 1] = ends[1:, 1] = slopes[1:]
        if len(slopes) > 1:
            ends[0, 1] = slopes[1]
    curved = {1: 1, 2: len(ends), 3: 0}[given]  # number of cubic segments, counted from the first
    _make_cubic(starts[:curved], ends[:curved], durations[:curved])
    return PiecewiseMotion(piecewise(times, starts, ends))


def _make_cubic(starts: Array, ends: Array, durations: Array) -> None:
    """Write accelerations that make the quintics between these states, shape (n, 3, joints), cubics."""
    chords = (ends[:, 0] - starts[:, 0]) / durations
    starts[:, 2] = (6.0 * chords - 4.0 * starts[:, 1] - 2.0 * ends[:, 1]) / durations
    ends[:, 2] = (-6.0 * chords + 2.0 * starts[:, 1] + 4.0 * ends[:, 1]) / durations


def stop(present: Array) -> PiecewiseMotion:
    """The motion from q, q', q'' at time 0, shape (3, joints), to rest within `STOP`; its acceleration is continuous.

    The end position is that of a quartic with the same other conditions, so the motion need not turn back or speed up.
    """
    end = np.zeros_like(present)
    end[0] = present[0] + STOP * (present[1] / 2.0 + STOP * present[2] / 12.0)
    return PiecewiseMotion(piecewise(np.array([0.0, STOP]), present[None], end[None]))


class MotionUnderWay:
    """A motion, and the next motion, which replaces it at its start time."""

    def __init__(self, motion: Motion, start: int, joints: int) -> None:
        """Args: motion: the first motion; start: its start time, ns; joints: number of joints."""
        self._motion, self._start = motion, start
        self._next: tuple[Motion, int] | None = None
        self._present = np.zeros((3, joints))

    def evaluate(self, now: int, desired: Array) -> None:
        """Write q_d, q_d', q_d'' at `now` (ns, not earlier than before) to desired, shape (3, joints)."""
        if self._next and now >= self._next[1]:
            (self._motion, self._start), self._next = self._next, None
        self._motion.evaluate(seconds(now - self._start), desired)

    def follow(self, now: int, start: int, times: Array, points: Array, tolerance: float) -> None:
        """Follow the points (see `plan`) from `start` (ns) on, or from `now` if `start` is in the past.

        The current motion continues until then; a motion that was waiting for its start is dropped.

        Raises:
            TrajectoryError: see `plan`; nothing changes.
        """
        begin = max(now, start)
        self.evaluate(now, self._present)
        self._motion.evaluate(seconds(begin - self._start), self._present)
        self._next = plan(times, points, seconds(begin - start), self._present, tolerance), start

    def cancel(self, now: int) -> None:
        """Come to rest (see `stop`) and stay there."""
        self.evaluate(now, self._present)
        self._motion, self._start, self._next = stop(self._present), now, None

    def approach(self, now: int, motion: Motion) -> None:
        """Change to this motion, which starts now; see `Approach`."""
        self.evaluate(now, self._present)
        self._motion, self._start, self._next = Approach(motion, self._present), now, None

    def move(self, later: int) -> None:
        """Shift the motions by `later` (ns), because the clock was set."""
        self._start += later
        if self._next:
            self._next = self._next[0], self._next[1] + later
