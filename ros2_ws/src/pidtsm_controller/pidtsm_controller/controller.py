"""Controller node: joint states and references in, effort commands out."""

import sys
import time

import numpy as np
from sensor_msgs.msg import JointState

from pidtsm_core.controller import Controller
from pidtsm_core.node_parameters import controller_node_schema
from pidtsm_core.parameters import names
from pidtsm_core.references import extrapolate
from pidtsm_core.robots import robot_joints
from pidtsm_core.signals import Signal
from pidtsm_core.timing import seconds
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.joints import JointOrder, MessageError, joint_field
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.process import run
from pidtsm_ros.stamps import nanoseconds, set_stamp


class ControllerNode(ManagedNode):
    """Answers every joint state with an effort command of the same stamp."""

    def __init__(self) -> None:
        super().__init__("controller", controller_node_schema, robot_joints)

    def configure(self) -> None:
        joints = list(names(self.values["joints"]))
        self._controller = Controller(self.values)
        self._order = JointOrder(joints)
        self._reference_order = JointOrder(joints)
        self._position = np.zeros(len(joints))
        self._reference = np.zeros((3, len(joints)))
        self._desired = np.zeros((3, len(joints)))
        self._by_stamp = self.values["reference.match"] == "stamp"
        # Compile before the loop.
        extrapolate(self._reference, 0.0, self._desired)
        self._controller.step(self._position, self._desired, 0.0)

        self._command = JointState(name=joints)
        self._effort = joint_field(self._command, "effort", len(joints))
        self._state = ControllerState(name=joints)
        self._state_rows = [joint_field(self._state, signal.name.lower(), len(joints)) for signal in Signal]

        self._commands = self.advertise(JointState, "joint_commands")
        self._states = self.advertise(ControllerState, "~/state")
        self.listen(JointState, "joint_states", self._on_joint_state)
        self.listen(JointReference, "reference", self._on_reference)

    def activate(self) -> None:
        self._controller.reset()
        self._last_stamp = -1
        self._waiting_stamp = -1
        self._reference_stamp = -1

    def parameters_changed(self) -> None:
        self._controller.set_parameters(self.values)

    def poll(self) -> float:
        if self.active and self._waiting_stamp >= 0:
            self._answer()
            return 0.005
        return super().poll()

    def _on_reference(self, reference: JointReference) -> None:
        for row, field in enumerate(("position", "velocity", "acceleration")):
            self._reference_order.read(reference.name, getattr(reference, field), field, self._desired[row])
        self._reference[:] = self._desired
        self._reference_stamp = nanoseconds(reference.header.stamp)
        if self._waiting_stamp >= 0:
            self._answer()

    def _on_joint_state(self, state: JointState) -> None:
        stamp = nanoseconds(state.header.stamp)
        if stamp == self._last_stamp:
            raise MessageError("two joint states have the same stamp")
        self._order.read(state.name, state.position, "position", self._position)
        self._waiting_stamp = stamp
        self._answer()

    def _answer(self) -> None:
        """Answer the joint state that waits, once there is a reference for it and somebody to hear the answer."""
        stamp = self._waiting_stamp
        if self._reference_stamp < 0 or (self._by_stamp and self._reference_stamp != stamp):
            return
        first = self._last_stamp < 0
        if first and self._commands.get_subscription_count() == 0:
            return
        if stamp < self._last_stamp:
            self.get_logger().warning("time went back: starting afresh")
            self._controller.reset()
            first = True
        began = time.perf_counter()
        extrapolate(self._reference, seconds(stamp - self._reference_stamp), self._desired)
        dt = 0.0 if first else seconds(stamp - self._last_stamp)
        self._last_stamp = stamp
        self._waiting_stamp = -1
        signals = self._controller.step(self._position, self._desired, dt)

        self._effort[:] = signals[Signal.EFFORT]
        set_stamp(self._command.header.stamp, stamp)
        compute_time = time.perf_counter() - began
        self._commands.publish(self._command)

        for row, values in zip(self._state_rows, signals, strict=True):
            row[:] = values
        self._state.header.stamp = self._command.header.stamp
        self._state.compute_time = compute_time
        self._states.publish(self._state)


def main() -> None:
    """Entry point of ``ros2 run pidtsm_controller controller``."""
    sys.exit(run(ControllerNode))
