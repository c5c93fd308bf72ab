"""Motions that are commanded point by point while another is under way."""

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
_APPROACH_VELOCITY = 0.5  # rad/s, mean of the joint that goes farthest


class TrajectoryError(ValueError):
    """A trajectory cannot be followed; the message says why."""


class Motion(Protocol):
    """A desired motion."""

    def evaluate(self, t: float, desired: Array) -> None:
        """Write q_d, q_d', q_d'' at t (s) to desired, shape (3, joints), rad, rad/s, rad/s^2."""


class PiecewiseMotion:
    """A motion of polynomials, see `piecewise`."""

    def __init__(self, parameters: Array) -> None:
        """Args: parameters: as `piecewise` returns them."""
        self._parameters = parameters

    def evaluate(self, t: float, desired: Array) -> None:
        """See `Motion.evaluate`."""
        evaluate(t, self._parameters, desired)


class Rest:
    """A position that is held."""

    def __init__(self, position: Array) -> None:
        """Args: position: shape (joints,), rad."""
        self._position = position.copy()

    def evaluate(self, t: float, desired: Array) -> None:
        """See `Motion.evaluate`."""
        desired[0] = self._position
        desired[1:] = 0.0


class Approach:
    """A motion, and the way to it from where one is: the difference dies out in a quintic."""

    def __init__(self, motion: Motion, present: Array) -> None:
        """Args: motion: to be approached from its beginning on; present: q, q', q'' at 0, shape (3, joints)."""
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
    """The motion through points: linear between positions, cubic with velocities, quintic with accelerations as well.

    It leaves the present motion with its position and velocity, and a quintic with its acceleration too; the way from
    there to the first point is therefore at least a cubic.

    Args:
        times: of the points, s from the start of the trajectory, shape (n,).
        points: positions, and velocities and accelerations where given, shape (n, 1 to 3, joints), rad, rad/s, rad/s^2.
        elapsed: s since the start; points up to here are passed over.
        present: q, q', q'' at that time, shape (3, joints).
        tolerance: farthest that the last point passed over may be from the present position, rad.

    Raises:
        TrajectoryError: times that do not increase, a motion that is over, does not end at rest, or begins elsewhere.
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
            f"point {passed} is due now, and {distance:.3g} rad from the present reference "
            f"{present[0].tolist()}; at most {tolerance:g} rad are allowed (start_tolerance)"
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
    curved = {1: 1, 2: len(ends), 3: 0}[given]  # segments from the first on that are cubics
    _make_cubic(starts[:curved], ends[:curved], durations[:curved])
    return PiecewiseMotion(piecewise(times, starts, ends))


def _make_cubic(starts: Array, ends: Array, durations: Array) -> None:
    """Write the accelerations with which the quintics between these states, shape (n, 3, joints), are cubics."""
    chords = (ends[:, 0] - starts[:, 0]) / durations
    starts[:, 2] = (6.0 * chords - 4.0 * starts[:, 1] - 2.0 * ends[:, 1]) / durations
    ends[:, 2] = (-6.0 * chords + 2.0 * starts[:, 1] + 4.0 * ends[:, 1]) / durations


def stop(present: Array) -> PiecewiseMotion:
    """The motion to rest within `STOP`, from q, q', q'' at 0, shape (3, joints); its acceleration is continuous.

    Where it ends is where a quartic does, which has neither to turn back nor to hurry.
    """
    end = np.zeros_like(present)
    end[0] = present[0] + STOP * (present[1] / 2.0 + STOP * present[2] / 12.0)
    return PiecewiseMotion(piecewise(np.array([0.0, STOP]), present[None], end[None]))


class MotionUnderWay:
    """A motion, and the one that replaces it when its time has come."""

    def __init__(self, motion: Motion, start: int, joints: int) -> None:
        """Args: motion: the first; start: when it begins, ns; joints: their number."""
        self._motion, self._start = motion, start
        self._next: tuple[Motion, int] | None = None
        self._present = np.zeros((3, joints))

    def evaluate(self, now: int, desired: Array) -> None:
        """Write q_d, q_d', q_d'' at `now` (ns, not earlier than before) to desired, shape (3, joints)."""
        if self._next and now >= self._next[1]:
            (self._motion, self._start), self._next = self._next, None
        self._motion.evaluate(seconds(now - self._start), desired)

    def follow(self, now: int, start: int, times: Array, points: Array, tolerance: float) -> None:
        """Follow the points, see `plan`, from `start` (ns) on, or from `now` where that is past.

        The motion under way goes on until then; one that was waiting for its time is dropped.

        Raises:
            TrajectoryError: see `plan`; nothing changes.
        """
        begin = max(now, start)
        self.evaluate(now, self._present)
        self._motion.evaluate(seconds(begin - self._start), self._present)
        self._next = plan(times, points, seconds(begin - start), self._present, tolerance), start

    def cancel(self, now: int) -> None:
        """Come to rest, see `stop`, and stay there."""
        self.evaluate(now, self._present)
        self._motion, self._start, self._next = stop(self._present), now, None

    def approach(self, now: int, motion: Motion) -> None:
        """Go over to this motion, which begins now, see `Approach`."""
        self.evaluate(now, self._present)
        self._motion, self._start, self._next = Approach(motion, self._present), now, None

    def move(self, later: int) -> None:
        """Go on so much later, ns: the clock has been set."""
        self._start += later
        if self._next:
            self._next = self._next[0], self._next[1] + later
