"""Controller node: joint states and references in, effort commands out."""

import time
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64MultiArray

from pidtsm_controller.activity_watch import ActivityWatch
from pidtsm_controller.adaptation_watch import AdaptationWatch
from pidtsm_controller.learnt_file import LearntFile
from pidtsm_controller.payload_change import HeldObject, PayloadChange
from pidtsm_controller.payload_watch import PayloadWatch
from pidtsm_controller.stiffness_topics import StiffnessTopics
from pidtsm_controller.watchdog import CHECK, Watchdog
from pidtsm_controller.wrench_watch import WrenchWatch
from pidtsm_core.control import Condition, Controller, Count
from pidtsm_core.experiment.node_parameters import (
    HELD_KNOWN,
    LEARNT_FILE,
    PAYLOAD_OBSERVED,
    WRENCH_PUBLISHED,
    controller_node_schema,
)
from pidtsm_core.messages.arrivals import Arrivals, Stamp
from pidtsm_core.messages.gaps import Continuation, continuation
from pidtsm_core.parameters import as_float, names
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.robots import robot_joints
from pidtsm_core.signals import Fault, Mode, Request, Signal, Status
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.diagnostics import Diagnostics, Reading, loop_readings
from pidtsm_ros.effort_topics import EFFORT_TOPICS
from pidtsm_ros.loop_statistics import LoopStatistics
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.process import run_nodes
from pidtsm_ros.qos import KEPT
from pidtsm_ros.serialization import serialize
from pidtsm_ros.stop import Stop
from pidtsm_ros.wire import IncomingMessages, OutgoingMessage, deserialize

_REFERENCE_FIELDS = ("position", "velocity", "acceleration", "effort")
_LOOP_FIELDS = ("period", "rate", "period_jitter", "state_age", "missed_deadlines", "compute_time")
_CALM = 1.0
"""s; sooner, the same warning is not logged again: a limit may be exceeded again and again."""
_NO_REFERENCE = serialize(JointReference())
"""Sent by the trajectory node in lockstep if there is no reference, because the controller waits for a message."""


def _is_none(data: bytes) -> bool:
    return len(data) == len(_NO_REFERENCE) and not deserialize(data, JointReference).name


@dataclass
class _Reported:
    """What the last diagnostics counted."""

    at_limit: int = 0
    implausible: int = 0


_CURE = "trajectory/go_to_arm brings the reference there"


class ControllerNode(ManagedNode):
    """Publishes an effort command with the same stamp for every joint state."""

    _controller: Controller

    def __init__(self, stop: Stop) -> None:
        super().__init__("controller", controller_node_schema, robot_joints, stop)
        self._diagnostics: Diagnostics | None = None
        self._ticks = 0  # since the last diagnostics
        self._reported = _Reported()
        self._status: tuple[int, ...] | None = None
        self._braked: bool | None = None
        self._warned: dict[str, float] = {}  # when, s

    @property
    def lockstep(self) -> bool:
        return self.values["reference.match"] == "stamp"

    def configure(self) -> None:
        joints = list(names(self.values["joints"]))
        topic = EFFORT_TOPICS[str(self.values["output.type"])]
        self._command = OutgoingMessage(topic.blank(joints), (topic.field,), joints=len(joints))
        self._state = OutgoingMessage(
            ControllerState(name=joints),
            [s.name.lower() for s in Signal],
            _LOOP_FIELDS,
            len(joints),
            [s.name.lower() for s in Status],
        )
        self._controller = Controller(self.values, self._command.arrays[0], self._state.arrays)
        self._controller.compile()
        for warning in self._controller.warnings():
            self.get_logger().warning(warning)
        fields = ("position", "effort") if self._controller.config.feeds_back else ("position",)
        self._statistics = LoopStatistics(as_float(self.values["diagnostics.deadline"]))
        self._incoming_state = IncomingMessages(JointState, fields, joints, others=True)
        self._incoming_reference = IncomingMessages(JointReference, _REFERENCE_FIELDS, joints, optional=("effort",))
        self._decimation = int(as_float(self.values["state.decimation"]))
        self._answered_stamp = self._waiting_stamp = -1
        self._state_arrivals, self._reference_arrivals = Arrivals(), Arrivals()
        self._watchdog = Watchdog()

        self._commands = self.advertise_alone(topic.message_type, topic.name)
        self._states = self.advertise(ControllerState, "~/state")
        self._brakes = self.advertise(Bool, "~/brakes", KEPT) if self.values["stop.brakes"] else None
        self._change, observed = PayloadChange(self, self._controller), self.values[PAYLOAD_OBSERVED.name]
        self._payload = PayloadWatch(self, self._controller, self._change) if observed else None
        self._held = HeldObject(self, self._change) if self.values[HELD_KNOWN.name] else None
        self._wrench = WrenchWatch(self, self._controller) if self.values[WRENCH_PUBLISHED.name] else None
        self._stiffness = StiffnessTopics(self, self._controller)
        self._adaptation = AdaptationWatch(self._controller)
        kept = str(self.values[LEARNT_FILE.name])
        self._learnt = LearntFile(kept, self._controller, tuple(joints), self.get_logger()) if kept else None
        self._activity = ActivityWatch(self, topic.name) if topic.message_type is Float64MultiArray else None
        self._diagnostics = Diagnostics(self)
        self.offer("~/reset_fault", self._reset_fault)
        self.offer_switch("~/freedrive", lambda on: self._request(Request.FREE if on else Request.HOLD))
        self.offer_switch("~/hold", lambda on: self._request(Request.HOLD if on else Request.FOLLOW))
        # Activation needs messages that arrive before it.
        self.listen(JointState, "joint_states", self._on_joint_state, raw=True, while_inactive=True, one_publisher=True)
        self.listen(JointReference, "reference", self._on_reference, raw=True, while_inactive=True, one_publisher=True)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._diagnostics = None
        return super().on_cleanup(state)

    def refusal(self) -> str:
        if self._state_arrivals.last < 0:
            return "no joint state received yet"
        age = self._watchdog.age
        if not self.lockstep and age > self._controller.state_stop:
            return f"the last joint state was received {age * 1e-9:.3g} s ago (watchdog.state_stop)"
        if not self.active and self._activity and (trouble := self._activity.trouble):
            return trouble
        follows = not self.active or self._controller.state.conditions[Condition.REQUEST] == Request.FOLLOW
        return self._too_far() if follows else ""

    def _too_far(self) -> str:
        reason = self._controller.refusal(self._reference_arrivals.last >= 0)
        return f"{reason}; {_CURE}" if reason else ""

    def activate(self) -> None:
        self._statistics.reset()
        self._ticks = 0
        # The first state is always published, regardless of state.decimation.
        self._unpublished = self._decimation - 1
        self._controller.reset()
        if self._learnt is not None:
            self._learnt.read()
        self._change.reset()
        if self._payload is not None:
            self._payload.reset()
        if self._wrench is not None:
            self._wrench.reset()
        if self._activity is not None:
            self._activity.begin()
        self._reported = _Reported()
        self._status = None
        self._waiting_stamp = self._state_arrivals.last
        self._engage_brakes()

    def deactivate(self) -> None:
        """Publish a last, safe torque; not in lockstep, where each joint state has its one command already.

        And not if another controller commands the arm.
        """
        if self._controller.commanded and not self.lockstep and not self.outdone:
            self._controller.leave()
            self._publish_once_more()
        if self._learnt is not None:
            self._learnt.write()

    def parameters_changed(self) -> None:
        if self._diagnostics is None:  # Not configured: `configure` will read them.
            return
        self._controller.set_parameters(self.values)
        self._change.parameters_changed()
        self._statistics.deadline = as_float(self.values["diagnostics.deadline"])
        self._decimation = int(as_float(self.values["state.decimation"]))
        for warning in self._controller.warnings():
            self.get_logger().warning(warning)

    def poll(self) -> float:
        if self._diagnostics is not None and self._diagnostics.due:
            self.diagnose()
        if not self.active:
            return super().poll()
        if self._waiting_stamp >= 0:
            self._answer()
        if self.lockstep:
            return CHECK if self._waiting_stamp >= 0 else super().poll()
        silence = self._watchdog.silence()
        if self._controller.commanded and silence > self._controller.state_stop:
            self._stop(silence)
            self._publish_once_more()
        return CHECK

    def _stop(self, silence: int) -> None:
        """Latch the fault of a gap between joint states, `silence` (ns) after the last one."""
        self._controller.stop(Fault.STATE_STALE, silence)
        if self._controller.status != self._status:
            self._report(self._controller.status)

    def _now(self) -> int | None:
        """Clock that stamps are compared with, ns; None in lockstep."""
        return None if self.lockstep else time.monotonic_ns()

    def _on_reference(self, data: bytes) -> None:
        stamp, now = serialized_nanoseconds(data), self._now()
        if not (self.lockstep and _is_none(data)):
            judged = self._reference_arrivals.judge(stamp, now)
            if judged in (Stamp.LATE, Stamp.AHEAD):
                raise MessageError(judged.explanation)
            self._incoming_reference.read(data, self._controller.given)
            self._reference_arrivals.take(judged, stamp, now)
        self._answered_stamp = stamp
        if self.active and self._waiting_stamp >= 0:
            self._answer()

    def _on_joint_state(self, data: bytes) -> None:
        stamp, now, arrivals = serialized_nanoseconds(data), self._now(), self._state_arrivals
        judged, last = arrivals.judge(stamp, now), arrivals.last
        if judged is Stamp.REPEATED and self.lockstep:
            # In lockstep the simulator repeats a joint state if it received no command for it.
            if self.active and self._waiting_stamp < 0:
                self._commands.publish(self._command.to_bytes(stamp))
            return
        if not judged.usable:
            raise MessageError(judged.explanation)
        self._incoming_state.read(data, self._controller.measured)
        arrivals.take(judged, stamp, now)
        self._waiting_stamp = stamp
        if judged is Stamp.RESTARTED:
            self._set_clock(stamp)
        if self.active and not self.lockstep and self._controller.commanded:
            longest = self._controller.state_stop
            if continuation(judged, stamp - last, arrivals.silence, longest) is Continuation.STOP:
                self._stop(max(arrivals.silence, stamp - last if judged is Stamp.NEW else 0))
        if not self.active:
            self._watchdog.received()
            self.retry_activation()
        if self.active:
            self._answer()
        self._watchdog.received()

    def _set_clock(self, stamp: int) -> None:
        """Go on in the new time of the joint states, from `stamp` (ns) on."""
        self.get_logger().warning(
            f"joint_states: {Stamp.RESTARTED.value}; holding position until new references arrive"
        )
        self._controller.set_clock(stamp, self._state_arrivals.elapsed)
        # References from before the change are invalid.
        if abs(self._reference_arrivals.last - stamp) > self._controller.state_stop:
            self._reference_arrivals.forget()

    def _answer(self) -> None:
        """Publish the command for the waiting joint state, once its reference and the subscribers are there."""
        stamp = self._waiting_stamp
        if self.lockstep and self._answered_stamp != stamp:
            return
        if self.awaits(self._commands.publisher):
            return
        began = time.perf_counter()
        status = self._controller.step(stamp, self._reference_arrivals.last)
        self._waiting_stamp = -1
        compute_time = time.perf_counter() - began
        self._commands.publish(self._command.to_bytes(stamp))

        # The rest is not time-critical.
        if status != self._status:
            self._report(status)
        if self._brakes is not None:
            self._engage_brakes()
        self._change.update(stamp)
        if self._payload is not None:
            self._payload.update(stamp)
        if self._wrench is not None:
            self._wrench.update(stamp)
        age = 0.0 if self.lockstep else self._state_arrivals.age(time.monotonic_ns(), time.time_ns()) * 1e-9
        statistics = self._statistics
        statistics.tick(time.monotonic_ns(), age, compute_time)
        self._ticks += 1
        self._unpublished += 1
        if self._unpublished < self._decimation:
            return
        self._unpublished = 0
        window = statistics.last
        self._state.set_scalars(statistics.period, window.rate, window.jitter, age, statistics.missed, compute_time)
        self._state.set_codes(*status)
        self._states.publish(self._state.to_bytes(stamp))

    def _report(self, status: tuple[int, ...]) -> None:
        """Log changes of the status."""
        for change in self._controller.changes(self._status):
            # One line of code per level: rclpy identifies logging calls by their line.
            if change.level == "error":
                self.get_logger().error(change.text)
            elif change.level == "info":
                self.get_logger().info(change.text)
            elif time.monotonic() - self._warned.get(change.text, -_CALM) >= _CALM:
                self.get_logger().warning(change.text)
                self._warned[change.text] = time.monotonic()
        self._status = status

    def _publish_once_more(self) -> None:
        """Publish an effort command without a new joint state."""
        self._commands.publish(self._command.to_bytes(self._state_arrivals.last))
        self._engage_brakes()

    def _engage_brakes(self) -> None:
        """Publish the state of the brakes, if the arm has brakes and the state has changed."""
        if self._brakes is None:
            return
        engaged = bool(self._controller.state.conditions[Condition.BRAKES])
        if engaged != self._braked:
            self._braked = engaged
            self._brakes.publish(Bool(data=engaged))

    def _reset_fault(self) -> str:
        """Reset the fault and follow again; returns the reason if refused, else an empty text."""
        if not self.active or not self._controller.fault:
            return "there is no fault"
        if refusal := self.refusal():
            return refusal
        self._controller.reset_fault()
        self._report(self._controller.status)
        return ""

    def _request(self, wanted: Request) -> str:
        """Follow, hold or be free; returns the reason if refused, else an empty text."""
        if not self.active:
            return "the controller is inactive"
        if wanted == Request.FOLLOW and (refusal := self._too_far()):
            return refusal
        return self._controller.request(wanted)

    def diagnose(self) -> None:
        if self._diagnostics is None:
            return
        ticks, self._ticks = self._ticks, 0
        window, judged = self._statistics.last, not self.lockstep
        at_limit = self._controller.state.counts[Count.AT_EFFORT_LIMIT]
        limited = (at_limit - self._reported.at_limit) / max(ticks, 1)
        readings = [
            *loop_readings(self._statistics, judged),
            Reading("state age, longest", window.longest_age, "s", "age" if judged else ""),
            Reading("samples at a torque limit", limited, "", "saturation"),
        ]
        gains = self._controller.state.signals[Signal.ADAPTIVE_GAIN]
        readings += [
            Reading(f"adaptive gain of {joint}", float(gain))
            for joint, gain in zip(names(self.values["joints"]), gains, strict=True)
        ]
        implausible, before = self._controller.state.counts[Count.IMPLAUSIBLE], self._reported.implausible
        readings += [
            Reading("late joint states since activation", self._controller.state.counts[Count.LATE]),
            Reading("stamps that were late or ahead", self._state_arrivals.refused),
            Reading("implausible joint states since activation", implausible),
        ]
        self._reported = _Reported(at_limit, implausible)
        if implausible > before:
            self.get_logger().warning(f"{implausible - before} joint states are implausible (plausibility.velocity)")
        idle, level = "", DiagnosticStatus.WARN
        if not self.active:
            idle = f"inactive: {self.rivalry() or self.refusal() or 'ready to be activated'}"
        elif not ticks:
            idle = f"no {'reference' if self._waiting_stamp >= 0 else 'joint state'} for a second"
        elif self._controller.fault:
            idle, level = "stopped by a fault; call ~/reset_fault to continue", DiagnosticStatus.ERROR
        elif self._status is not None:
            idle = self._idle(Mode(self._status[Status.MODE]))
        self._stiffness.save()
        readings += self._adaptation.readings()
        for line in self._adaptation.news():
            self.get_logger().info(line)
        self._diagnostics.publish(readings, idle, level, self._statistics.scale)

    def _idle(self, mode: Mode) -> str:
        """Why an active controller without a fault does not follow; empty if it does."""
        if mode == Mode.FREEDRIVE:
            return "in freedrive; call ~/freedrive with false to hold the arm"
        if mode == Mode.HOLDING and self._controller.state.conditions[Condition.REQUEST] == Request.HOLD:
            return "holding position; call ~/hold with false to follow the reference"
        return "holding position: the reference is missing or too old" if mode == Mode.HOLDING else ""


def run(stop: Stop) -> int:
    """``ros2 run pidtsm_controller controller``; returns the exit code."""
    return run_nodes([ControllerNode], stop)
