"""How well an arm follows a trajectory: on the way within the path tolerance, and in time at the goal."""

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.timing import seconds

_SMOOTHING = 0.03
"""Time constant of the filter for the velocity error, s. Encoders of 14 bit are then within 0.01 rad/s most of the
time, the usual tolerance for an arm at rest."""

REACHED = "Goal successfully reached!"
VIOLATED = "Aborted due to path tolerance violation"


class Code(IntEnum):
    """Error codes of ``control_msgs/action/FollowJointTrajectory``."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


class Outcome(NamedTuple):
    """How a goal has ended."""

    code: Code
    text: str


class Tolerances(NamedTuple):
    """Largest deviations; infinite: any."""

    path: Array  # of position and velocity on the way, shape (2, joints), rad, rad/s
    goal: Array  # likewise at the end
    goal_time: float  # time after the end within which the arm must be within `goal`, s


class Tracking:
    """Judges how an arm follows a trajectory, sample by sample, by the rules of joint_trajectory_controller.

    The texts begin with those of that controller, which clients may know.

    Attributes:
        error: measured minus desired position and velocity, shape (2, joints), rad, rad/s. The velocity is the filtered
            derivative of the position error, so that the filter delays the error and not the motion.
    """

    def __init__(
        self, joints: Sequence[str], continuous: NDArray[np.bool_], tolerances: Tolerances, start: int, end: int
    ) -> None:
        """Begin before the first sample.

        Args:
            joints: their names.
            continuous: whether a joint turns without end, so that positions a turn apart are the same, shape (joints,).
            tolerances: largest deviations.
            start: time 0 of the trajectory, ns.
            end: time of its last point, ns.
        """
        self._joints, self._continuous, self._tolerances = joints, continuous, tolerances
        self._start, self._end = start, end
        self._last = -1  # time of the last sample, ns
        self._smooth = np.zeros(len(joints))
        self.error = np.zeros((2, len(joints)))

    def judge(self, now: int, desired: Array, position: Array) -> Outcome | None:
        """The outcome, None while there is none. The first sample counts as one of the way, even after the end.

        Args:
            now: time of the sample, ns.
            desired: q_d, q_d', q_d'', shape (3, joints), rad, rad/s, rad/s^2.
            position: measured, shape (joints,), rad.
        """
        first = self._last < 0
        self._measure(now, desired[0], position)
        if (now < self._end or first) and (violation := self._violation(now)):
            return violation
        if now < self._end:
            return None
        beyond = np.abs(self.error) - self._tolerances.goal
        if beyond.max() <= 0.0:
            return Outcome(Code.SUCCESSFUL, REACHED)
        late = seconds(now - self._end)
        if late <= self._tolerances.goal_time:
            return None
        what, allowed = self._largest(beyond, self._tolerances.goal), self._tolerances.goal_time
        return Outcome(
            Code.GOAL_TOLERANCE_VIOLATED,
            f"Aborted due to goal_time_tolerance exceeding by {late:f} seconds: {what} at the goal; allow more in "
            f"goal_tolerance or in goal_time_tolerance ({allowed:g} s)",
        )

    def _measure(self, now: int, desired: Array, position: Array) -> None:
        error = position - desired
        np.subtract(error, math.tau * np.round(error / math.tau), out=error, where=self._continuous)
        self.error[0] = error
        if self._last < 0:
            self._smooth[:] = error
        elif now > self._last:
            elapsed = seconds(now - self._last)
            change = -math.expm1(-elapsed / _SMOOTHING) * (error - self._smooth)
            self._smooth += change
            self.error[1] = change / elapsed
        self._last = now

    def _violation(self, now: int) -> Outcome | None:
        beyond = np.abs(self.error) - self._tolerances.path
        if beyond.max() <= 0.0:
            return None
        what = self._largest(beyond, self._tolerances.path)
        return Outcome(
            Code.PATH_TOLERANCE_VIOLATED,
            f"{VIOLATED}: {what}, {seconds(now - self._start):.3f} s after the start; move more slowly, or allow more "
            "in path_tolerance",
        )

    def _largest(self, beyond: Array, tolerances: Array) -> str:
        """The deviation that is farthest beyond its tolerance."""
        row, joint = (int(i) for i in np.unravel_index(np.argmax(beyond), beyond.shape))
        what = f"{self._joints[joint]}: {('position', 'velocity')[row]} error {abs(self.error[row, joint]):.4g}"
        return f"{what} exceeds the tolerance {tolerances[row, joint]:g}"
