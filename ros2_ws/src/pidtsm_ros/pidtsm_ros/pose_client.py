"""Motions of the tool, for a client of a running system."""

import time
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.poses.kinematics import ToolKinematics
from pidtsm_core.poses.parameters import TOOL_FRAME
from pidtsm_core.poses.paths import Speed, arc, line, plan_path
from pidtsm_core.poses.pose import Pose, read_pose, read_rotation, read_vector
from pidtsm_core.robots import DESCRIPTION, OF_ARM, find_robot
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_ros.client_errors import GoalError, TargetError
from pidtsm_ros.serialization import ExactPublisher
from pidtsm_ros.stamps import set_stamp

_DEPTH, _PATIENCE = 10, 10.0
"""Queue length, and the longest time to find the trajectory node, s."""


def pose_message(
    position: Sequence[float] | Array, orientation: Sequence[float] | Array, stamp: int, frame: str = ""
) -> PoseStamped:
    """A target of a stream of poses, see docs/poses.md.

    Args:
        position: x, y, z, shape (3,), m.
        orientation: unit quaternion x, y, z, w, shape (4,).
        stamp: ns.
        frame: a link of the arm, or a frame on ``tf``; empty: the base frame.
    """
    message = PoseStamped()
    message.header.frame_id = frame
    set_stamp(message.header.stamp, stamp)
    for target, values in ((message.pose.position, position), (message.pose.orientation, orientation)):
        for name, value in zip("xyzw", values, strict=False):
            setattr(target, name, float(value))
    return message


class PoseMotions:
    """What `pidtsm_ros.client.Arm` does with its tool.

    The tool is that of the description of the arm, or the link that the trajectory node has as ``poses.tool``. A pose
    is a position x, y, z (m) and a quaternion x, y, z, w.
    """

    limits: MotionLimits
    state: Any
    _node: Node
    _settings: Mapping[str, Any]

    @cached_property
    def _kinematics(self) -> ToolKinematics:
        """The kinematics of the tool.

        Raises:
            TargetError: it is not known what the arm is, or mink is not installed.
        """
        if DESCRIPTION.name not in self._settings:
            raise TargetError(f"poses need the arm: give Arm a robot, or the trajectory node {DESCRIPTION.name}")
        robot = find_robot({name: self._settings[name] for name in OF_ARM if name in self._settings})
        try:
            return ToolKinematics(robot, self.limits, str(self._settings.get(TOOL_FRAME.name, "")))
        except ParameterError as error:
            raise TargetError(str(error)) from None

    @property
    def tool(self) -> Pose:
        """Where the tool should be now, in the base frame.

        Raises:
            TargetError: it is not known what the arm is, or mink is not installed.
        """
        return self._kinematics.pose(self.state.desired[0])

    def move_to_pose(
        self,
        position: Sequence[float] | Array,
        orientation: Sequence[float] | Array | None = None,
        via: Sequence[float] | Array | None = None,
        frame: str = "",
        speed: Speed | None = None,
        wait: bool = True,
    ) -> float:
        """Move the tool on a straight line, or on the arc of a circle.

        Args:
            position: x, y, z, shape (3,), m.
            orientation: quaternion x, y, z, w, shape (4,); None: that of now.
            via: a point x, y, z (m) through which the arc goes; None: a straight line.
            frame: link of the arm, where it is now, from which all this is seen; empty: the base frame.
            speed: limits of the tool; None: 0.25 m/s, 1 m/s^2, 1 rad/s, 4 rad/s^2.
            wait: return when the arm is there.

        Returns:
            Duration of the motion, s.

        Raises:
            GoalError: the motion is not possible, was rejected or not completed.
            TargetError: numbers that are no pose, or no such frame.
        """
        start = self._resting()
        seen_from = self._frame(frame)
        try:
            place = read_vector("position", position)
            axes = read_rotation(orientation) if orientation is not None else seen_from.rotation.T @ start.rotation
            through = None if via is None else read_vector("via", via)
        except TrajectoryError as error:
            raise TargetError(str(error)) from None
        end = seen_from @ Pose(place, axes)
        try:
            if through is None:
                poses = line(start, end)
            else:
                poses = arc(start, seen_from.position + seen_from.rotation @ through, end)
        except TrajectoryError as error:
            raise GoalError(str(error)) from None
        return self.follow_poses(poses, speed, wait)

    def follow_poses(self, poses: Sequence[Pose], speed: Speed | None = None, wait: bool = True) -> float:
        """Move the tool through poses without stopping, such as those of `pidtsm_core.poses.paths.line`.

        Args:
            poses: at least two, in the base frame, a few mm apart; the first is where the tool is.
            speed: limits of the tool; None: as for `move_to_pose`.
            wait: return when the arm is there.

        Returns:
            Duration of the motion, s.

        Raises:
            GoalError: the motion is not possible, was rejected or not completed.
        """
        self._resting()
        try:
            motion = plan_path(self._kinematics, self.state.desired[0], poses, self.limits, speed)
        except TrajectoryError as error:
            raise GoalError(str(error)) from None
        self.follow(motion)
        if wait:
            self.wait(10.0 + 2.0 * motion.end)
        return motion.end

    def stream_pose(
        self, position: Sequence[float] | Array, orientation: Sequence[float] | Array, frame: str = ""
    ) -> None:
        """Send one pose of a stream, see docs/poses.md; call it at 10 to 250 Hz.

        Args:
            position: x, y, z, shape (3,), m.
            orientation: quaternion x, y, z, w, shape (4,).
            frame: a link of the arm, or a frame on ``tf``; empty: the base frame.

        Raises:
            TargetError: numbers that are no pose.
        """
        try:
            read_pose(position, orientation)
        except TrajectoryError as error:
            raise TargetError(str(error)) from None
        self._poses.publish(pose_message(position, orientation, time.time_ns(), frame))

    @cached_property
    def _poses(self) -> Any:
        """The publisher of poses, once the trajectory node listens."""
        publisher = self._node.create_publisher(
            PoseStamped, "trajectory/pose_target", _DEPTH, publisher_class=ExactPublisher
        )
        self._await(publisher.get_subscription_count, _PATIENCE, "the node trajectory takes no poses")
        return publisher

    def _resting(self) -> Pose:
        """Where the tool is, after the arm has come to rest."""
        self._come_to_rest()
        return self.tool

    def _frame(self, name: str) -> Pose:
        if not name:
            return Pose(np.zeros(3), np.eye(3))
        if name not in self._kinematics.links:
            raise TargetError(f"unknown frame {name}; expected: {', '.join(self._kinematics.links)}")
        return self._kinematics.pose(self.state.desired[0], name)

    # Of the arm.

    def follow(self, trajectory: Any) -> None:
        """See `pidtsm_ros.client.Arm`."""
        raise NotImplementedError

    def wait(self, timeout: float) -> None:
        """See `pidtsm_ros.client.Arm`."""
        raise NotImplementedError

    def _come_to_rest(self) -> None:
        raise NotImplementedError

    def _await(self, condition: Any, timeout: float, otherwise: str) -> None:
        raise NotImplementedError
