"""Controller node: joint states and references in, effort commands out."""

import time

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import JointState

from pidtsm_controller.tick import ROWS, Row, Violation, answer, begin_following, hold, make_safe
from pidtsm_core.controller import Controller
from pidtsm_core.laws import Numbers
from pidtsm_core.node_parameters import PRIORITY, controller_node_schema
from pidtsm_core.parameters import Array, names, number
from pidtsm_core.robots import robot_joints
from pidtsm_core.signals import Signal
from pidtsm_core.timing import NANOSECONDS
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.diagnostics import Diagnostics, Reading, loop_readings
from pidtsm_ros.effort_topics import EFFORT_TOPICS
from pidtsm_ros.joints import MessageError
from pidtsm_ros.loop_statistics import LoopStatistics
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.stamps import serialized_nanoseconds
from pidtsm_ros.wire import IncomingMessages, OutgoingMessage

_REFERENCE_FIELDS = ("position", "velocity", "acceleration")
_LOOP_FIELDS = ("period", "rate", "period_jitter", "state_age", "missed_deadlines", "compute_time")


_LIMITS = {
    Violation.POSITION: ("position", Row.POSITION, ControllerState.POSITION_LIMIT),
    Violation.VELOCITY: ("velocity", Row.VELOCITY, ControllerState.VELOCITY_LIMIT),
    Violation.TRACKING: ("tracking_error", Row.TRACKING, ControllerState.TRACKING_LIMIT),
}
_RESTARTED = 1.0
"""s; stamps that go back by more come from a source that was started anew, others are refused."""
_CHECK = 0.005
"""s between two looks at the watchdog."""


class ControllerNode(ManagedNode):
    """Answers every joint state with an effort command of the same stamp."""

    # Memory and numbers of the controller, table, torque, signals: what `answer` takes.
    _arrays: tuple[Array, Numbers, Array, Array, Array]

    def __init__(self) -> None:
        super().__init__("controller", controller_node_schema, robot_joints)
        self._fault = ControllerState.NO_FAULT
        self._diagnostics: Diagnostics | None = None
        self._ticks = self._late = 0
        self._polled = self._attentive_since = 0

    @property
    def lockstep(self) -> bool:
        return self.values["reference.match"] == "stamp"

    @property
    def priority(self) -> int:
        return 0 if self.lockstep else int(number(self.values[PRIORITY.name]))

    def configure(self) -> None:
        joints = list(names(self.values["joints"]))
        self._controller = Controller(self.values)
        self._table = np.zeros((ROWS, len(joints)))
        self._position = self._table[Row.MEASURED : Row.MEASURED + 1]
        self._reference = self._table[Row.REFERENCE : Row.REFERENCE + 3]
        self._statistics = LoopStatistics(number(self.values["diagnostics.deadline"]))

        topic = EFFORT_TOPICS[str(self.values["output.type"])]
        self._command = OutgoingMessage(topic.blank(joints), (topic.field,), joints=len(joints))
        self._state = OutgoingMessage(
            ControllerState(name=joints),
            [s.name.lower() for s in Signal],
            _LOOP_FIELDS,
            len(joints),
            ("mode", "fault"),
        )
        self._incoming_state = IncomingMessages(JointState, ("position",), joints)
        self._incoming_reference = IncomingMessages(JointReference, _REFERENCE_FIELDS, joints)
        self._effort, self._signals = self._command.arrays[0], self._state.arrays
        self._take_parameters()
        self._start_afresh()
        self._reference_stamp = self._state_stamp = -1
        self._arrived = 0
        # Compile before the loop.
        answer(*self._arrays, 0, 0, 0, False, False)
        make_safe(*self._arrays)
        hold(self._table, self._position[0])
        begin_following(self._table, 0)

        self._commands = self.advertise(topic.message_type, topic.name)
        self._states = self.advertise(ControllerState, "~/state")
        self._diagnostics = Diagnostics(self)
        self.offer("~/reset_fault", self._reset_fault)
        # What comes before activation is needed for it.
        self.listen(JointState, "joint_states", self._on_joint_state, raw=True, while_inactive=True)
        self.listen(JointReference, "reference", self._on_reference, raw=True, while_inactive=True)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._diagnostics = None
        return super().on_cleanup(state)

    def refusal(self) -> str:
        if self._state_stamp < 0:
            return "no joint state so far"
        silence = (time.monotonic_ns() - self._arrived) * 1e-9
        if not self.lockstep and silence > number(self.values["watchdog.state_stop"]):
            return f"the last joint state came {silence:.3g} s ago (watchdog.state_stop)"
        if self._reference_stamp >= 0:
            distance = np.abs(self._reference[0] - self._position[0])
            limit = number(self.values["activation.distance"])
            if distance.max() > limit:
                joint = names(self.values["joints"])[int(distance.argmax())]
                return f"{joint} is {distance.max():.3g} rad from its reference (activation.distance {limit:g})"
        return ""

    def activate(self) -> None:
        self._statistics.reset()
        self._ticks = 0
        self._late = 0
        self._warned = 0
        # The first tick is told.
        self._untold = self._decimation - 1
        self._fault = ControllerState.NO_FAULT
        self._start_afresh()
        self._waiting_stamp = self._state_stamp

    def deactivate(self) -> None:
        """Leave the arm with a safe torque; where every stamp has one command, none is left to take it."""
        if self._last_stamp >= 0 and not self.lockstep:
            self._publish_safe(self._last_stamp)

    def parameters_changed(self) -> None:
        self._controller.set_parameters(self.values)
        self._statistics.deadline = number(self.values["diagnostics.deadline"])
        self._take_parameters()

    def _take_parameters(self) -> None:
        values, table = self.values, self._table
        self._arrays = (self._controller.memory, self._controller.numbers, table, self._effort, self._signals)
        table[Row.BLEND] = number(values["activation.blend"])
        kind = values["stop.effort"]
        table[Row.GRAVITY] = kind in ("gravity", "gravity_damping")
        table[Row.DAMPING] = values["stop.damping"] if kind in ("damping", "gravity_damping") else 0.0
        table[Row.EFFORT_RATE] = values["limits.effort_rate"]
        self._stopping = 0
        for violation, (name, row, _) in _LIMITS.items():
            table[row] = values[f"limits.{name}"]
            if values[f"limits.{name}_action"] == "stop":
                self._stopping |= violation
        self._state_hold = number(values["watchdog.state_hold"]) * NANOSECONDS
        self._state_stop = number(values["watchdog.state_stop"]) * NANOSECONDS
        self._decimation = int(number(values["state.decimation"]))
        self._reference_timeout = number(values["watchdog.reference"]) * NANOSECONDS

    def _start_afresh(self) -> None:
        """Forget the motion so far; what follows begins where the arm is."""
        self._controller.reset()
        self._table[Row.SATURATED] = 0.0
        self._table[Row.EFFORT] = 0.0
        self._last_stamp = self._waiting_stamp = -1
        self._following = self._holding = False
        self._followed_since = 0

    def poll(self) -> float:
        if self._diagnostics is not None and self._diagnostics.due:
            self._publish_diagnostics()
        if not self.active:
            return super().poll()
        if self._waiting_stamp >= 0:
            self._answer()
        if self.lockstep:
            return _CHECK if self._waiting_stamp >= 0 else super().poll()
        # Where this process was not running itself, what arrived meanwhile comes after this.
        now = time.monotonic_ns()
        if now - self._polled > 2 * _CHECK * NANOSECONDS:
            self._attentive_since = now
        self._polled = now
        silence = now - max(self._arrived, self._attentive_since)
        if silence > self._state_stop and self._last_stamp >= 0 and not self._fault:
            self._stop(ControllerState.STATE_STALE, f"no joint state for {silence * 1e-9:.3g} s")
            self._publish_safe(self._last_stamp)
        return _CHECK

    def _on_reference(self, data: bytes) -> None:
        self._incoming_reference.read(data, self._reference)
        self._reference_stamp = serialized_nanoseconds(data)
        if self.active and self._waiting_stamp >= 0:
            self._answer()

    def _on_joint_state(self, data: bytes) -> None:
        stamp = serialized_nanoseconds(data)
        elapsed = stamp - self._state_stamp
        if elapsed <= 0 and self._state_stamp >= 0:
            if not elapsed and self.lockstep:
                # Lockstep asks again for an answer that did not arrive.
                if stamp == self._last_stamp:
                    self._commands.publish(self._command.to_bytes(stamp))
                return
            if not elapsed:
                raise MessageError("two joint states have the same stamp")
            if elapsed > -_RESTARTED * NANOSECONDS:
                raise MessageError("the stamp goes back")
        self._incoming_state.read(data, self._position)
        self._state_stamp = stamp
        if elapsed < 0 and self.active and self._last_stamp >= 0:
            self.get_logger().warning("time went back: starting afresh")
            self._start_afresh()
            # A reference of the time before says nothing.
            if self._reference_stamp > stamp:
                self._reference_stamp = -1
        self._waiting_stamp = stamp
        if not self.active:
            self._arrived = time.monotonic_ns()
            self.retry_activation()
        if self.active:
            self._answer()
        self._arrived = time.monotonic_ns()

    def _answer(self) -> None:
        """Answer the joint state that waits, once there is a reference for it and somebody to hear the answer."""
        stamp = self._waiting_stamp
        if self.lockstep and self._reference_stamp != stamp:
            return
        first = self._last_stamp < 0
        if first and self._commands.get_subscription_count() == 0:
            return
        began = time.perf_counter()
        period = 0 if first else stamp - self._last_stamp
        if period > self._state_hold:
            self._late += 1
            if period > self._state_stop and not self._fault:
                self._stop(ControllerState.STATE_STALE, f"no joint state for {period * 1e-9:.3g} s")
        if first:
            hold(self._table, self._position[0])
        reference_age = stamp - self._reference_stamp
        if not self._following or self._fault or abs(reference_age) > self._reference_timeout:
            self._choose_desired(stamp)
        violations = answer(
            *self._arrays, reference_age, period, stamp - self._followed_since, self._holding, self._fault != 0
        )
        self._last_stamp = stamp
        self._waiting_stamp = -1
        if violations != self._warned:
            self._violated(violations)
        compute_time = time.perf_counter() - began
        self._commands.publish(self._command.to_bytes(stamp))

        # What follows nobody waits for.
        age = 0.0 if self.lockstep else (time.time_ns() - stamp) * 1e-9
        statistics = self._statistics
        statistics.tick(time.monotonic_ns(), age, compute_time)
        self._ticks += 1
        self._untold += 1
        if self._untold < self._decimation:
            return
        self._untold = 0
        window = statistics.last
        self._state.set_scalars(statistics.period, window.rate, window.jitter, age, statistics.missed, compute_time)
        self._state.set_codes(self._mode(), self._fault)
        self._states.publish(self._state.to_bytes(stamp))

    def _mode(self) -> int:
        if self._fault:
            return ControllerState.STOPPED
        return ControllerState.FOLLOWING if self._following else ControllerState.HOLDING

    def _choose_desired(self, stamp: int) -> None:
        """Follow the reference while there is one that is not too old, else hold the position desired last.

        Once held, it takes one of half that age: references that are late by about the limit would switch to and fro.
        """
        known = self._reference_stamp >= 0
        age = stamp - self._reference_stamp
        fresh = known and abs(age) <= self._reference_timeout / (1 if self._following else 2)
        if self._fault:
            fresh = False
        if fresh and not self._following:
            begin_following(self._table, age)
            self._followed_since = stamp
            if self._holding:
                self.get_logger().info("following the reference")
        elif not fresh and not self._holding:
            hold(self._table, self._table[Row.DESIRED].copy())
            if self._following and not self._fault:
                distance = f"{abs(age) * 1e-9:.3g} s {'old' if age > 0 else 'ahead'}"
                self.get_logger().warning(f"holding position: the reference is {distance}")
        self._following, self._holding = fresh, not fresh

    def _violated(self, violations: int) -> None:
        """Limits are exceeded that were not before, or the other way round."""
        begun, self._warned = violations & ~self._warned, violations
        for violation, (name, _, fault) in _LIMITS.items():
            if not begun & violation:
                continue
            if violation & self._stopping:
                if not self._fault:
                    self._stop(fault, f"a joint is beyond limits.{name}")
                    make_safe(*self._arrays)
            else:
                self.get_logger().warning(f"a joint is beyond limits.{name}")

    def _stop(self, fault: int, reason: str) -> None:
        self._fault = fault
        self.get_logger().error(f"stopped: {reason}; safe torque until ~/reset_fault is called")

    def _publish_safe(self, stamp: int) -> None:
        make_safe(*self._arrays)
        self._commands.publish(self._command.to_bytes(stamp))

    def _reset_fault(self) -> str:
        """Follow again after a fault; returns why not, or nothing."""
        if not self.active or not self._fault:
            return "there is no fault"
        if refusal := self.refusal():
            return refusal
        self._fault = ControllerState.NO_FAULT
        self._warned = 0
        self._start_afresh()
        self.get_logger().info("fault reset")
        return ""

    def _publish_diagnostics(self) -> None:
        ticks, self._ticks = self._ticks, 0
        window, judged = self._statistics.last, not self.lockstep
        saturated = self._table[Row.SATURATED] / max(ticks, 1)
        self._table[Row.SATURATED] = 0.0
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
        readings.append(Reading("late joint states since activation", self._late))
        idle, level = "", DiagnosticStatus.WARN
        if not self.active:
            idle = f"inactive: {self.refusal() or 'to be activated'}"
        elif not ticks:
            idle = f"no {'reference' if self._waiting_stamp >= 0 else 'joint state'} for a second"
        elif self._fault:
            idle, level = "stopped by a fault; ~/reset_fault ends it", DiagnosticStatus.ERROR
        elif self._holding:
            idle = "holding position: no reference, or an old one"
        assert self._diagnostics is not None
        self._diagnostics.publish(readings, idle, level)
