"""The state of the node as ros2_control's trajectory controller publishes it, for the tools that read that."""

import math

import numpy as np
from control_msgs.msg import JointTrajectoryControllerState
from trajectory_msgs.msg import JointTrajectoryPoint

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import as_float
from pidtsm_core.timing import NANOSECONDS
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.stamps import set_stamp


class ControllerStates:
    """Publishes reference, measured position and error on ``~/controller_state``, if somebody subscribes."""

    def __init__(self, node: ManagedNode, limits: MotionLimits) -> None:
        """Args: node: the trajectory node, while it is configured; limits: of the arm."""
        self._joints, self._continuous = list(limits.joints), limits.continuous
        self._publisher = node.advertise(JointTrajectoryControllerState, "~/controller_state")
        self._period = round(NANOSECONDS / as_float(node.values["action_monitor_rate"]))
        self._next = 0  # ns

    def due(self, now: int) -> bool:
        """Whether to `publish` at `now` (ns): as often as feedback, ``action_monitor_rate``."""
        if 0 < self._next - now <= self._period:
            return False
        self._next = now + self._period
        return bool(self._publisher.get_subscription_count())

    def publish(self, now: int, desired: Array, position: Array) -> None:
        """Publish a state.

        Args:
            now: stamp of the joint state, ns.
            desired: the reference, shape (3, joints), rad, rad/s, rad/s^2.
            position: measured, shape (joints,), rad.
        """
        error = desired[0] - position
        error -= np.where(self._continuous, math.tau * np.round(error / math.tau), 0.0)
        message = JointTrajectoryControllerState(
            joint_names=self._joints,
            reference=JointTrajectoryPoint(
                positions=desired[0].tolist(), velocities=desired[1].tolist(), accelerations=desired[2].tolist()
            ),
            feedback=JointTrajectoryPoint(positions=position.tolist()),
            error=JointTrajectoryPoint(positions=error.tolist()),
            speed_scaling_factor=1.0,
        )
        set_stamp(message.header.stamp, now)
        self._publisher.publish(message)
