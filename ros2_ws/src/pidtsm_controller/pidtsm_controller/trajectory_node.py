"""Trajectory node: publishes a reference for every joint state and accepts trajectories that replace it."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from pidtsm_controller.controller_watch import ControllerWatch
from pidtsm_controller.joint_jogs import JointJogs
from pidtsm_controller.large_trajectories import LARGE, LargeTrajectories
from pidtsm_controller.pose_streams import PoseStreams
from pidtsm_controller.streams import CHUNK, Streams
from pidtsm_controller.trajectory_points import places, read_points
from pidtsm_core.arrays import Array
from pidtsm_core.experiment.node_parameters import trajectory_node_schema
from pidtsm_core.messages.arrivals import Arrivals, Stamp
from pidtsm_core.parameters import as_float, names
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.references import ReferenceMotion, reference_joints
from pidtsm_core.timing import seconds
from pidtsm_core.trajectories.checking import prepare
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import motion_limits
from pidtsm_core.trajectories.motion import Rest
from pidtsm_core.trajectories.splice import MotionUnderWay, unwind
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.diagnostics import Diagnostics, Reading
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.process import run_nodes, spin_for
from pidtsm_ros.qos import RELIABLE_READER
from pidtsm_ros.stamps import nanoseconds
from pidtsm_ros.stop import Stop
from pidtsm_ros.wire import IncomingMessages, OutgoingMessage, deserialize

if TYPE_CHECKING:
    from pidtsm_controller.follow_joint_trajectory import GoalServer
    from pidtsm_controller.introspection import ControllerStates

_WAITING = 20
"""Queue length for joint states. A node that falls behind at 1 kHz is then at most 20 ms late and skips joint states.
With the default queue length, its references could be older than the controller allows (``watchdog.reference``)."""
_NO_STATE = "no joint state received yet, so the start time is unknown"
_FAREWELL = 0.1
"""Time in which results of goals are sent when the process ends, s."""


class TrajectoryNode(ManagedNode):
    """Publishes q_d, q_d', q_d'' with the stamp of every joint state; the motion begins at the first one.

    A goal of ``~/follow_joint_trajectory`` or a trajectory on ``joint_trajectory`` replaces the current motion; a
    trajectory without points brings it to rest.
    The node's time is that of the joint states, simulated or real. If their clock is set, or their source restarts,
    the motion comes to rest where the arm is; ``~/begin`` starts the built-in motion again. ``~/go_to_arm`` brings the
    reference to an arm that is elsewhere, so that the controller can be activated.
    """

    def __init__(self, stop: Stop) -> None:
        super().__init__("trajectory", trajectory_node_schema, reference_joints, stop)
        self._diagnostics: Diagnostics | None = None
        self._goals: GoalServer | None = None
        self._states: ControllerStates | None = None

    @property
    def lockstep(self) -> bool:
        return self.values["clock"] == "lockstep"

    def configure(self) -> None:
        joints = list(names(self.values["joints"]))
        self._measured = IncomingMessages(JointState, ("position",), joints, others=True)
        self._position = np.zeros((1, len(joints)))
        self._built_in = ReferenceMotion(self.values)
        self._limits = motion_limits(self.values)
        prepare(self._limits)
        self._desired = np.zeros((3, len(joints)))
        # Compile before the loop.
        self._built_in.evaluate(0.0, self._desired)
        self._motion = MotionUnderWay(self._built_in, 0, self._limits)
        self._motion.approach(0, self._built_in)
        self._motion.cancel(0)
        self._motion.evaluate(0, self._desired)

        fields = ("position", "velocity", "acceleration", "effort")
        self._reference = OutgoingMessage(JointReference(name=joints), fields, joints=len(joints))
        self._reference.arrays[3] = self._built_in.config.feedforward
        self._none = OutgoingMessage(JointReference())

        self._references = self.advertise_alone(JointReference, "reference")
        self._diagnostics = Diagnostics(self)
        self._published = 0
        self.offer("~/begin", self._begin)
        self.offer("~/go_to_arm", self._go_to_arm)
        self._offer_action()
        self._streams = Streams(self, self._limits, self._replace_goals)
        self._poses = PoseStreams(self, self._limits, self._streams, self.values)
        self._jogs = JointJogs(self, self._limits, self._streams, self.values)
        self._listening = False
        self._large = LargeTrajectories(self, self._limits, self.lockstep)
        self.listen(JointTrajectory, "joint_trajectory", self._receive_trajectory, raw=True, profile=RELIABLE_READER)

    def activate(self) -> None:
        self._arrivals, self._newest = Arrivals(), b""
        self._began = -1
        self._streams.forget()
        self._poses.forget()
        self._jogs.forget()

    def deactivate(self) -> None:
        self._large.forget("nothing, as the node was deactivated,")
        if self._goals:
            reason = "Current goal cancelled during deactivate transition: the node was deactivated"
            self._goals.end_all(reason, -1)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        if self._diagnostics is not None:
            self._large.destroy()
            self._poses.destroy()
        self._diagnostics = None
        if self._goals:
            self._goals.destroy()
            self._goals = self._states = None
        return super().on_cleanup(state)

    def flush(self, until: float) -> None:
        if self._goals and self.executor:
            spin_for(self.executor, _FAREWELL)
        super().flush(until)

    def _offer_action(self) -> None:
        """Serve ~/follow_joint_trajectory, and publish ~/controller_state, if the interfaces are there."""
        try:
            from pidtsm_controller.follow_joint_trajectory import GoalServer
            from pidtsm_controller.introspection import ControllerStates
        except ModuleNotFoundError:
            self.get_logger().info(
                "no action ~/follow_joint_trajectory, because control_msgs is missing: ./pidtsm actions builds it"
            )
            return
        self._goals, self._watch = GoalServer(self, self._limits), ControllerWatch()
        self._states = ControllerStates(self, self._limits)
        self.listen(ControllerState, "controller/state", self._watch.receive, raw=True, depth=1)

    def diagnose(self) -> None:
        if self._diagnostics is not None:
            idle = self._streams.stopped if self.active else "inactive"
            refused = self._arrivals.refused if self.active else 0
            readings = [
                Reading("references published", self._published),
                Reading("stamps that were late or ahead", refused),
            ]
            self._diagnostics.publish([*readings, *self._streams.readings(), *self._poses.readings()], idle)

    def poll(self) -> float:
        if self._diagnostics is not None and self._diagnostics.due:
            self.diagnose()
        if self._goals:
            self._goals.look_for_the_arm()
        if self._diagnostics is None or self._listening:
            return super().poll()
        # Subscribe only now, so that a simulator that waits for subscribers also waits for those of the reference.
        if not self.awaits(self._references.publisher) and not self.rivalry():
            self._listening = True
            self.listen(JointState, "joint_states", self._on_joint_state, raw=True, depth=_WAITING)
        return 0.02

    def _on_joint_state(self, state: bytes) -> None:
        # Read only the stamp, at a fraction of the cost of the whole message.
        stamp, arrivals = serialized_nanoseconds(state), self._arrivals
        now = None if self.lockstep else time.monotonic_ns()
        judged, last = arrivals.judge(stamp, now), arrivals.last
        if judged in (Stamp.LATE, Stamp.AHEAD) or (judged is Stamp.REPEATED and not self.lockstep):
            raise MessageError(judged.explanation)
        if last < 0:
            self.listen_again()
        restarts = judged is Stamp.RESTARTED
        if restarts:
            self._measured.read(state, self._position)
        arrivals.take(judged, stamp, now)
        self._newest = state
        if restarts:
            self._rest(self._position[0], last + arrivals.elapsed, stamp)
        if self._began < 0:
            if self.rivalry():  # Of two that have waited for the arm, only one begins.
                return
            self._began = stamp
            self._motion = MotionUnderWay(self._built_in, stamp, self._limits)
        self._large.advance(stamp, self._motion, self._large_takes_over)
        self._streams.advance(stamp, self._motion, bool(self._goals and self._goals.busy))
        self._poses.advance(stamp)
        self._jogs.advance(stamp)
        if self._goals:
            self._goals.trouble = self._watch.trouble
            self._goals.advance(stamp, self._motion)
        self._publish(stamp)
        if self._goals and self._goals.watching:
            self._measured.read(state, self._position)
            self._goals.judge(stamp, self._desired, self._position[0])
        if self._states and self._states.due(stamp):
            self._measured.read(state, self._position)
            self._states.publish(stamp, self._desired, self._position[0])

    def _publish(self, stamp: int) -> None:
        if self._built_in.drops_out(seconds(stamp - self._began)):
            # In lockstep the controller waits for a message.
            if self.lockstep:
                self._references.publish(self._none.to_bytes(stamp))
            return
        self._motion.evaluate(stamp, self._desired)
        self._reference.arrays[:3] = self._desired
        if self._goals:
            np.add(self._built_in.config.feedforward, self._goals.effort(stamp), out=self._reference.arrays[3])
        self._published += 1
        self._references.publish(self._reference.to_bytes(stamp))

    def _rest(self, position: Array, before: int, stamp: int) -> None:
        """Bring the motion to rest, or hold `position` (rad) if the reference is elsewhere.

        The new time `stamp` (ns) corresponds to the old time `before` (ns).
        """
        self._streams.forget()
        self._poses.forget()
        self._jogs.forget()
        self._large.forget("a stop, as the clock was set,")
        self._motion.move(stamp - before)
        self._motion.evaluate(stamp, self._desired)
        if np.abs(self._desired[0] - position).max() <= as_float(self.values["start_tolerance"]):
            self._motion.cancel(stamp)
        else:
            self._motion = MotionUnderWay(Rest(position), stamp, self._limits)
        self._began = stamp
        if self._goals:
            self._goals.end_all(f"joint_states: {Stamp.RESTARTED.value}", stamp)
        self.get_logger().warning(
            f"joint_states: {Stamp.RESTARTED.value}; holding the arm where it is; "
            "call ~/begin to start the built-in motion"
        )

    def _begin(self) -> str:
        """Start the built-in motion again from the current reference; returns the reason if refused, else nothing."""
        if not self.active or self._arrivals.last < 0:
            return _NO_STATE
        self._began = self._arrivals.last
        self._streams.give_way()
        self._motion.approach(self._began, self._built_in)
        self._replace_goals("the built-in motion")
        self.get_logger().info("starting the built-in motion")
        return ""

    def _go_to_arm(self) -> str:
        """Move the reference to where the arm is, to rest there; returns the reason if refused, else nothing."""
        if not self.active or self._arrivals.last < 0:
            return _NO_STATE
        try:
            self._measured.read(self._newest, self._position)
        except MessageError as error:
            return f"the last joint state cannot be used: {error}"
        last = self._arrivals.last
        there = unwind(self._position[np.newaxis], self._motion.state_at(last)[0], self._limits)[0, 0]
        self._streams.give_way()
        self._motion.approach(last, Rest(there))
        self._replace_goals("a motion to the arm")
        self.get_logger().info("moving the reference to the arm")
        return ""

    def _receive_trajectory(self, data: bytes) -> None:
        if len(data) >= LARGE and self._arrivals.last >= 0:
            self._large.receive(data)
        else:
            self._on_trajectory(deserialize(data, JointTrajectory))

    def _on_trajectory(self, message: JointTrajectory) -> None:
        last = self._arrivals.last
        if last < 0:
            raise MessageError(_NO_STATE)
        if not message.points:
            self._motion.cancel(last)
            self._streams.give_way()
            self._replace_goals("a stop")
            self.get_logger().info("cancelled: coming to rest")
            return
        columns = places(message.joint_names, self._limits.joints, partial=False)
        times, given = read_points(message)
        points = np.empty_like(given)
        points[:, :, columns] = given
        start = nanoseconds(message.header.stamp) or last
        try:
            self._motion.follow(last, start, times, points, as_float(self.values["start_tolerance"]))
        except TrajectoryError as error:
            moves = points.shape[1] > 1 and points[-1, 1].any()
            raise MessageError(f"{error}; a stream goes to {CHUNK}" if moves else str(error)) from None
        self._streams.give_way()
        self._replace_goals("a trajectory on joint_trajectory")
        self.get_logger().info(f"following a trajectory of {len(times)} points, {times[-1]:g} s")

    def _large_takes_over(self) -> None:
        self._streams.give_way()
        self._replace_goals("a trajectory on joint_trajectory")

    def _replace_goals(self, by: str) -> None:
        self._large.forget(by)
        if self._goals:
            self._goals.end_all(f"replaced by {by}", self._arrivals.last)


def run(stop: Stop) -> int:
    """``ros2 run pidtsm_controller trajectory``; returns the exit code."""
    return run_nodes([TrajectoryNode], stop)
