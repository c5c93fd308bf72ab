"""Controller node: joint states and references in, effort commands out."""

import sys
import time

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import JointState

from pidtsm_core.compiled import njit
from pidtsm_core.controller import Controller, ControllerConfig, tick
from pidtsm_core.controller import ControllerState as ControllerMemory
from pidtsm_core.node_parameters import PRIORITY, controller_node_schema
from pidtsm_core.parameters import Array, names, number
from pidtsm_core.references import extrapolate
from pidtsm_core.robots import robot_joints
from pidtsm_core.signals import Signal
from pidtsm_core.timing import seconds
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.diagnostics import Diagnostics, Reading, loop_readings
from pidtsm_ros.joints import MessageError
from pidtsm_ros.loop_statistics import LoopStatistics
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.process import run
from pidtsm_ros.stamps import serialized_nanoseconds
from pidtsm_ros.wire import IncomingMessages, OutgoingMessage

_REFERENCE_FIELDS = ("position", "velocity", "acceleration")
_LOOP_FIELDS = ("period", "rate", "period_jitter", "state_age", "missed_deadlines", "compute_time")


@njit
def answer(
    config: ControllerConfig,
    state: ControllerMemory,
    q: Array,
    truth: Array,
    reference: Array,
    desired: Array,
    ages: NDArray[np.int64],
    effort: Array,
) -> None:
    """One tick against a reference of another moment: a single call, whose way into compiled code costs most of it.

    Args:
        config: what the tick reads.
        state: what it changes.
        q: measured positions, shape (joints,), rad.
        truth: see `tick`.
        reference: q_d, q_d', q_d'' as received, shape (3, joints).
        desired: scratch for the same continued to the sample.
        ages: of the reference, and of the last tick, ns, shape (2,).
        effort: result, shape (joints,), N m.
    """
    extrapolate(reference, seconds(ages[0]), desired)
    tick(config, state, q, truth, desired, seconds(ages[1]))
    for j in range(effort.size):
        effort[j] = state.signals[Signal.EFFORT, j]


class ControllerNode(ManagedNode):
    """Answers every joint state with an effort command of the same stamp."""

    def __init__(self) -> None:
        super().__init__("controller", controller_node_schema, robot_joints)

    @property
    def priority(self) -> int:
        return 0 if self.values["reference.match"] == "stamp" else int(number(self.values[PRIORITY.name]))

    def configure(self) -> None:
        joints = list(names(self.values["joints"]))
        self._controller = Controller(self.values)
        self._measured = np.zeros((1, len(joints)))
        self._reference = np.zeros((3, len(joints)))
        self._desired = np.zeros((3, len(joints)))
        self._saturated = np.zeros(len(joints))
        self._by_stamp = self.values["reference.match"] == "stamp"
        self._statistics = LoopStatistics(number(self.values["diagnostics.deadline"]))
        self._no_truth = np.zeros((2, len(joints)))
        self._ages = np.zeros(2, np.int64)

        self._command = OutgoingMessage(JointState(name=joints), ("effort",), joints=len(joints))
        self._state = OutgoingMessage(
            ControllerState(name=joints), [s.name.lower() for s in Signal], _LOOP_FIELDS, len(joints)
        )
        self._incoming_state = IncomingMessages(JointState, ("position",), joints)
        self._incoming_reference = IncomingMessages(JointReference, _REFERENCE_FIELDS, joints)

        self._effort, self._position = self._command.arrays[0], self._measured[0]
        # Compile before the loop.
        self._tick()

        self._commands = self.advertise(JointState, "joint_commands")
        self._states = self.advertise(ControllerState, "~/state")
        self._diagnostics = Diagnostics(self)
        self.listen(JointState, "joint_states", self._on_joint_state, raw=True)
        self.listen(JointReference, "reference", self._on_reference, raw=True)

    def activate(self) -> None:
        self._controller.reset()
        self._statistics.reset()
        self._saturated[:] = 0.0
        self._ticks = 0
        self._last_stamp = -1
        self._waiting_stamp = -1
        self._reference_stamp = -1

    def parameters_changed(self) -> None:
        self._controller.set_parameters(self.values)
        self._statistics.deadline = number(self.values["diagnostics.deadline"])

    def poll(self) -> float:
        if not self.active:
            return super().poll()
        if self._diagnostics.due:
            self._publish_diagnostics()
        if self._waiting_stamp >= 0:
            self._answer()
            return 0.005
        return super().poll()

    def _on_reference(self, data: bytes) -> None:
        self._incoming_reference.read(data, self._reference)
        self._reference_stamp = serialized_nanoseconds(data)
        if self._waiting_stamp >= 0:
            self._answer()

    def _on_joint_state(self, data: bytes) -> None:
        stamp = serialized_nanoseconds(data)
        if stamp == self._last_stamp:
            raise MessageError("two joint states have the same stamp")
        self._incoming_state.read(data, self._measured)
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
        self._ages[0] = stamp - self._reference_stamp
        self._ages[1] = 0 if first else stamp - self._last_stamp
        self._last_stamp = stamp
        self._waiting_stamp = -1
        self._tick()
        compute_time = time.perf_counter() - began
        self._commands.publish(self._command.to_bytes(stamp))

        # What follows nobody waits for.
        age = 0.0 if self._by_stamp else (time.time_ns() - stamp) * 1e-9
        statistics, signals = self._statistics, self._controller.state.signals
        statistics.tick(time.monotonic_ns(), age, compute_time)
        self._ticks += 1
        self._saturated += signals[Signal.SATURATED]
        window = statistics.last
        self._state.arrays[:] = signals
        self._state.scalars[:] = (
            statistics.period,
            window.rate,
            window.jitter,
            age,
            statistics.missed,
            compute_time,
        )
        self._states.publish(self._state.to_bytes(stamp))

    def _tick(self) -> None:
        answer(
            self._controller.config,
            self._controller.state,
            self._position,
            self._no_truth,
            self._reference,
            self._desired,
            self._ages,
            self._effort,
        )

    def _publish_diagnostics(self) -> None:
        ticks, self._ticks = self._ticks, 0
        window, judged = self._statistics.last, not self._by_stamp
        saturated = self._saturated / max(ticks, 1)
        self._saturated[:] = 0.0
        readings = [
            *loop_readings(self._statistics, judged),
            Reading("state age, longest", window.longest_age, "s", "age" if judged else ""),
            Reading("samples at a torque limit", float(saturated.max()), "", "saturation"),
        ]
        gains = self._controller.state.signals[Signal.ADAPTIVE_GAIN]
        readings += [
            Reading(f"adaptive gain of {joint}", float(gain))
            for joint, gain in zip(names(self.values["joints"]), gains, strict=True)
        ]
        lacking = "reference" if self._waiting_stamp >= 0 else "joint state"
        self._diagnostics.publish(readings, "" if ticks else f"no {lacking} for a second")


def main() -> None:
    """Entry point of ``ros2 run pidtsm_controller controller``."""
    sys.exit(run([ControllerNode]))
