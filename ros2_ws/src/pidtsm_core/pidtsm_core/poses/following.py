"""A tool that follows poses and twists which arrive one by one."""

from dataclasses import dataclass, field

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.poses.frames import Frames
from pidtsm_core.poses.kinematics import Distance, ToolKinematics
from pidtsm_core.poses.pose import Pose

FAR = 5e-3, 0.02
"""The tool is off its target if it is farther away, m and rad."""
_LEASH = 0.01, 0.05
"""How far the target of a twist runs ahead of the tool, m and rad."""


@dataclass(frozen=True)
class PoseTarget:
    """Where the tool should be.

    Attributes:
        frame: name of the frame; empty: the base frame.
        pose: of the tool in this frame.
    """

    frame: str
    pose: Pose


@dataclass(frozen=True)
class TwistTarget:
    """How the tool should move.

    Attributes:
        frame: name of the frame whose axes the velocities have; empty: the base frame.
        linear: velocity of the origin of the tool, m/s, shape (3,).
        angular: rad/s, shape (3,).
    """

    frame: str
    linear: Array
    angular: Array


@dataclass
class ToolFollower:
    """Turns targets of the tool into targets of the joints.

    Attributes:
        kinematics: of the tool.
        base: name of the base frame.
        frames: other frames than those of the arm.
    """

    kinematics: ToolKinematics
    base: str
    frames: Frames = field(default_factory=Frames)
    _ahead: Pose | None = None  # target of the twist

    def begin(self, q: Array) -> None:
        """A stream begins at these positions of the joints, shape (joints,), rad or m; its posture is preferred."""
        self.kinematics.prefer(q)
        self._ahead = None

    def follow(self, q: Array, target: PoseTarget | TwistTarget, duration: float) -> tuple[Array, Distance]:
        """The next target of the joints, and what is left to the target of the tool.

        Args:
            q: the last target of the joints, shape (joints,), rad or m.
            target: of the tool.
            duration: time since the last target, s.

        Raises:
            TrajectoryError: the frame of the target is not known.
        """
        frame = self.frames.find(target.frame, self.base, lambda name: self._link(q, name))
        if isinstance(target, PoseTarget):
            self._ahead = None
            return self.kinematics.toward(q, frame @ target.pose, duration)
        present = self.kinematics.pose(q)
        ahead = self._ahead or present
        way, turn = present.way_to(ahead)
        if np.linalg.norm(way) > _LEASH[0] or (self.kinematics.full and np.linalg.norm(turn) > _LEASH[1]):
            ahead = present
        axes = frame.rotation
        self._ahead = ahead.moved(duration * axes @ target.linear, duration * axes @ target.angular)
        return self.kinematics.toward(q, self._ahead, duration)

    def _link(self, q: Array, name: str) -> Pose | None:
        return self.kinematics.pose(q, name) if name in self.kinematics.links else None


def explain(left: Distance) -> str:
    """Why the tool is off its target; empty if it is not."""
    if left.position <= FAR[0] and left.angle <= FAR[1]:
        return ""
    if left.at_limit:
        return f"{', '.join(left.at_limit)} at the limit"
    return "near a singularity" if left.singular else "out of reach, or faster than the arm"
