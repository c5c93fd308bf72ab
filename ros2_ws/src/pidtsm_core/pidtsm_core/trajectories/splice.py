"""A motion that is under way, and what replaces it."""

import math

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.timing import seconds
from pidtsm_core.trajectories.checking import check
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.interpolation import Interpolation, plan
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.motion import Approach, Motion, PiecewiseMotion
from pidtsm_core.trajectories.stopping import stop

_TURN = 2.0 * math.pi


def unwind(points: Array, present: Array, limits: MotionLimits) -> Array:
    """The same points, with the first one at the turn next to the present position, of joints that turn without end.

    Args:
        points: shape (n, 1 to 3, joints), rad, rad/s, rad/s^2.
        present: position, shape (joints,), rad.
        limits: of the arm.
    """
    turns = np.where(limits.continuous, np.round((present - points[0, 0]) / _TURN), 0.0)
    unwound = points.copy()
    unwound[:, 0] += _TURN * turns
    return unwound


def plan_from(
    present: Array,
    elapsed: float,
    given: tuple[Array, Array],
    tolerance: float,
    limits: MotionLimits,
    interpolation: Interpolation = "linear",
) -> PiecewiseMotion:
    """Plan the rest of a trajectory, see `plan`, within limits; it may take long.

    Args:
        present: q, q', q'' where it takes over, shape (3, joints).
        elapsed: time since the start of the trajectory then, s.
        given: times and points, see `plan`.
        tolerance: see `plan`.
        limits: of the arm.
        interpolation: see `plan`.

    Raises:
        TrajectoryError: see `plan` and `check`.
    """
    times, points = given
    motion = plan(times, unwind(points, present[0], limits), elapsed, present, tolerance, interpolation)
    check(motion, limits)
    return motion


class MotionUnderWay:
    """A motion, and the next motion, which replaces it at its start time."""

    def __init__(self, motion: Motion, start: int, limits: MotionLimits) -> None:
        """Args: motion: the first motion; start: its start time, ns; limits: of the arm, for `follow` and `cancel`."""
        self._motion, self._start = motion, start
        self._next: tuple[Motion, int, int] | None = None
        self._limits = limits
        self._now = start

    def evaluate(self, now: int, desired: Array) -> None:
        """Write q_d, q_d', q_d'' at `now` (ns, not earlier than before) to desired, shape (3, joints)."""
        self._advance(now)
        self._motion.evaluate(seconds(now - self._start), desired)

    def _advance(self, now: int) -> None:
        self._now = now
        if self._next and now >= self._next[2]:
            (self._motion, self._start, _), self._next = self._next, None

    @property
    def current(self) -> Motion:
        """The present motion."""
        return self._motion

    def state_at(self, time: int) -> Array:
        """q_d, q_d', q_d'' of the present motion at `time` (ns, not in the past), shape (3, joints)."""
        state = np.zeros((3, len(self._limits.joints)))
        self._motion.evaluate(seconds(time - self._start), state)
        return state

    def replace(self, motion: Motion, start: int, begin: int) -> None:
        """Change to a motion, whose time 0 is `start` (ns), at `begin` (ns); one that was waiting is dropped.

        Raises:
            TrajectoryError: `begin` is over; nothing changes.
        """
        if begin < self._now:
            raise TrajectoryError(f"it was planned {seconds(self._now - begin):g} s too late")
        self._next = motion, start, begin

    def withdraw(self) -> None:
        """Drop the motion that waits for its begin."""
        self._next = None

    def follow(
        self,
        now: int,
        start: int,
        times: Array,
        points: Array,
        tolerance: float,
        interpolation: Interpolation = "linear",
    ) -> None:
        """Follow the points (see `plan`) from `start` (ns) on, or from `now` if `start` is in the past.

        The current motion continues until then; a motion that was waiting for its start is dropped.

        Raises:
            TrajectoryError: see `plan` and `check`; nothing changes.
        """
        begin = max(now, start)
        self._advance(now)
        given = times, points
        motion = plan_from(self.state_at(begin), seconds(begin - start), given, tolerance, self._limits, interpolation)
        self.replace(motion, start, begin)

    def cancel(self, now: int) -> None:
        """Come to rest (see `stop`) and stay there."""
        self._advance(now)
        self._motion, self._start, self._next = stop(self.state_at(now), self._limits), now, None

    def approach(self, now: int, motion: Motion) -> None:
        """Change to this motion, which starts now; see `Approach`."""
        self._advance(now)
        self._motion, self._start, self._next = Approach(motion, self.state_at(now)), now, None

    def move(self, later: int) -> None:
        """Shift the motions by `later` (ns), because the clock was set."""
        self._start += later
        self._now += later
        if self._next:
            motion, start, begin = self._next
            self._next = motion, start + later, begin + later
