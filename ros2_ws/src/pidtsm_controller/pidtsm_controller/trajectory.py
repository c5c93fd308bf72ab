"""Trajectory node: publishes the reference for every joint state."""

import sys

import numpy as np
from sensor_msgs.msg import JointState

from pidtsm_core.node_parameters import trajectory_node_schema
from pidtsm_core.parameters import names
from pidtsm_core.references import ReferenceMotion, reference_joints
from pidtsm_core.timing import seconds
from pidtsm_msgs.msg import JointReference
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.process import run
from pidtsm_ros.stamps import serialized_nanoseconds
from pidtsm_ros.wire import OutgoingMessage


class Trajectory(ManagedNode):
    """Publishes q_d, q_d', q_d'' with the stamp of every joint state; the motion starts at the first one.

    Driven by the joint states, the node needs no clock of its own, and lives in their time, simulated or not.
    """

    def __init__(self) -> None:
        super().__init__("trajectory", trajectory_node_schema, reference_joints)

    def configure(self) -> None:
        joints = list(names(self.values["joints"]))
        self._motion = ReferenceMotion(self.values)
        self._desired = np.zeros((3, len(joints)))
        # Compile before the loop.
        self._motion.evaluate(0.0, self._desired)

        fields = ("position", "velocity", "acceleration")
        self._reference = OutgoingMessage(JointReference(name=joints), fields, joints=len(joints))

        self._references = self.advertise(JointReference, "reference")
        self.listen(JointState, "joint_states", self._on_joint_state, raw=True)

    def activate(self) -> None:
        self._start = -1
        self._last = -1
        self._waiting = -1

    def parameters_changed(self) -> None:
        self._motion = ReferenceMotion(self.values)

    def poll(self) -> float:
        if self.active and self._waiting >= 0:
            self._publish(self._waiting)
            return 0.005
        return super().poll()

    def _on_joint_state(self, state: bytes) -> None:
        # Only the time matters here, at a fraction of the cost of the whole message.
        stamp = serialized_nanoseconds(state)
        if self._start < 0 or stamp < self._last:
            self._start = stamp
        self._last = stamp
        self._publish(stamp)

    def _publish(self, stamp: int) -> None:
        # The first reference waits for somebody to hear it.
        if stamp == self._start and self._references.get_subscription_count() == 0:
            self._waiting = stamp
            return
        self._waiting = -1
        self._motion.evaluate(seconds(stamp - self._start), self._desired)
        self._reference.arrays[:] = self._desired
        self._references.publish(self._reference.to_bytes(stamp))


def main() -> None:
    """Entry point of ``ros2 run pidtsm_controller trajectory``."""
    sys.exit(run([Trajectory]))
