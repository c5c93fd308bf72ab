"""A client of a running system: moves the arm from Python, without a node or an executor of the caller's."""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any

import numpy as np
import rclpy
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pidtsm_core.arrays import Array
from pidtsm_core.control.report import cause
from pidtsm_core.poses.parameters import TOOL_FRAME
from pidtsm_core.robots import DESCRIPTION
from pidtsm_core.robots.definition import ArmDefinition, find_arm
from pidtsm_core.signals import Mode
from pidtsm_core.timing import NANOSECONDS
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import PARAMETERS, MotionLimits, motion_limits, with_arm
from pidtsm_core.trajectories.motion import PiecewiseMotion
from pidtsm_core.trajectories.timing import retime
from pidtsm_msgs.msg import ControllerState
from pidtsm_ros.client_errors import ArmError, ArmNotFoundError, GoalError, TargetError
from pidtsm_ros.middleware import set_defaults
from pidtsm_ros.pose_client import PoseMotions
from pidtsm_ros.qos import READER
from pidtsm_ros.security import SecurityError, prepare_process
from pidtsm_ros.serialization import ExactPublisher
from pidtsm_ros.stamps import set_stamp
from pidtsm_ros.wire import deserialize

__all__ = ["Arm", "ArmError", "ArmNotFoundError", "ArmState", "GoalError", "TargetError"]

_ACTION = "trajectory/follow_joint_trajectory"
_POLL = 0.02
"""Longest time between two looks at a condition, s; Ctrl-C takes effect between them."""
_AT_REST = 1e-3
"""Largest velocity of a reference at rest, rad/s."""
_TO_REST = 10.0
"""Longest time until the reference rests, s."""
_SUCCESS, _CANCELED = 4, 5
"""action_msgs/GoalStatus."""


@dataclass(frozen=True)
class ArmState:
    """State of the arm; the arrays have shape (joints,).

    Attributes:
        names: of the joints.
        position: estimated, rad or m.
        velocity: rad/s or m/s.
        effort: commanded, N m or N.
        desired: desired position and velocity, shape (2, joints).
        mode: of the controller.
        fault: why the controller has stopped; empty if it has not.
    """

    names: tuple[str, ...]
    position: Array
    velocity: Array
    effort: Array
    desired: Array
    mode: Mode
    fault: str


class Arm(PoseMotions):
    """The arm of a running system, as a context manager.

    Motions are planned here, with the limits that the trajectory node has, so that planning costs the node no time and
    an error is raised before anything is sent. They are sent to the action ``follow_joint_trajectory`` if the system
    serves it, otherwise to the topic ``joint_trajectory``, which gives no answer: then only the end is watched.
    """

    def __init__(self, namespace: str = "", robot: str | ArmDefinition = "", timeout: float = 10.0) -> None:
        """Find the system.

        Args:
            namespace: of its nodes.
            robot: arm whose limits apply if the trajectory node has none: a name, also that of a stored arm, the path
                of a description, or an `ArmDefinition`.
            timeout: longest time to find it, s.

        Raises:
            ArmError: security is requested but not available; the enclave is ``/pidtsm/arm_client`` by default.
            ArmNotFoundError: there is no trajectory node or no controller in this namespace.
            ParameterError: there is no such robot, or it has other joints.
        """
        set_defaults()
        self._context = rclpy.Context()
        try:
            rclpy.init(args=prepare_process(["arm_client"]), context=self._context)
        except SecurityError as error:
            raise ArmError(str(error)) from None
        self._node = Node("arm_client", context=self._context, namespace=namespace, enable_rosout=False)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._closing = False
        self._goal: Any = None
        self._result: Future | None = None
        self._target: Array | None = None
        self._state = b""
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        try:
            self._connect(robot, timeout)
        except ArmError as error:
            self.close()
            raise ArmNotFoundError(str(error)) from None
        except BaseException:
            self.close()
            raise

    def _connect(self, robot: str | ArmDefinition, timeout: float) -> None:
        node = self._node
        node.create_subscription(ControllerState, "controller/state", self._on_state, READER, raw=True)
        self._trajectories = node.create_publisher(
            JointTrajectory, "joint_trajectory", 10, publisher_class=ExactPublisher
        )
        self._targets = node.create_publisher(
            JointState, "trajectory/joint_target", QoSProfile(depth=10), publisher_class=ExactPublisher
        )
        self._parameters = node.create_client(GetParameters, "trajectory/get_parameters")
        self._action = self._make_action()
        where = f"in the namespace {node.get_namespace()}"
        self._await(self._parameters.service_is_ready, timeout, f"no node trajectory {where}")
        self._await(lambda: self._state, timeout, f"no controller that publishes its state {where}")
        self._await(self._targets.get_subscription_count, timeout, f"no node trajectory that is configured {where}")
        self.limits = self._read_limits(robot, timeout)
        if self._action and not self._action.wait_for_server(1.0):
            self._action.destroy()
            self._action = None

    def _make_action(self) -> Any:
        """A client of the action, None without its interfaces."""
        try:
            from control_msgs.action import FollowJointTrajectory
            from rclpy.action import ActionClient
        except ModuleNotFoundError:
            return None
        self._goal_type = FollowJointTrajectory.Goal
        return ActionClient(self._node, FollowJointTrajectory, _ACTION)

    def _read_limits(self, robot: str | ArmDefinition, timeout: float) -> MotionLimits:
        names = ["joints", TOOL_FRAME.name, *(parameter.name for parameter in PARAMETERS)]
        response = self._answer(self._parameters.call_async(GetParameters.Request(names=names)), timeout)
        values = {name: _value(value) for name, value in zip(names, response.values, strict=True)}
        if robot and not values[DESCRIPTION.name]:
            values = with_arm(values, find_arm(robot))
        self._settings = {name: value for name, value in values.items() if value not in (None, "", [], ())}
        return motion_limits(self._settings)

    def __enter__(self) -> "Arm":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None and self._result is not None:
            self.hold(wait=False)
        self.close()

    def close(self) -> None:
        """Leave the system; a motion under way goes on."""
        self._closing = True
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of all arrays."""
        return self.limits.joints

    @property
    def uses_action(self) -> bool:
        """Whether motions are goals of the action; otherwise they are sent to the topic."""
        return self._action is not None

    @property
    def state(self) -> ArmState:
        """The last state that the controller has published."""
        message = deserialize(self._state, ControllerState)
        order = [list(message.name).index(name) for name in self.names]
        fields = ("position", "velocity", "effort", "position_error", "velocity_error")
        q, dq, effort, e, de = (np.array(getattr(message, field))[order] for field in fields)
        stopped = message.mode == Mode.STOPPED
        fault = cause(message.fault, message.fault_joint, message.name) if stopped else ""
        return ArmState(self.names, q, dq, effort, np.array([q - e, dq - de]), Mode(message.mode), fault)

    def move_to(
        self, target: Sequence[float] | Array | Mapping[str, float], velocity_scale: float = 1.0, wait: bool = True
    ) -> float:
        """Move on the straight line between two postures, as fast as the limits allow.

        Args:
            target: position of all joints, rad or m, in the order of `names`, shape (joints,), or of some by name; the
                others hold.
            velocity_scale: share of the largest velocity, above 0 and at most 1.
            wait: return when the arm is there.

        Returns:
            Duration of the motion, s.

        Raises:
            GoalError: the motion is not possible, was rejected or not completed.
            TargetError: the number or the name of a joint, or the scale, is wrong.
        """
        if not 0.0 < velocity_scale <= 1.0:
            raise TargetError(f"velocity_scale {velocity_scale:g}: must be above 0 and at most 1")
        self._come_to_rest()
        start = self.state.desired[0]
        end = self._posture(target, start)
        try:
            limits = replace(self.limits, velocity=velocity_scale * self.limits.velocity)
            motion = retime(np.array([start, end]), limits)
        except TrajectoryError as error:
            raise GoalError(str(error)) from None
        self.follow(motion)
        if wait:
            self.wait(10.0 + 2.0 * motion.end)
        return motion.end

    def _posture(self, target: Sequence[float] | Array | Mapping[str, float], start: Array) -> Array:
        if isinstance(target, Mapping):
            if unknown := [name for name in target if name not in self.names]:
                raise TargetError(f"unknown joints {', '.join(unknown)}; expected: {', '.join(self.names)}")
            return np.array([target.get(name, start[j]) for j, name in enumerate(self.names)], dtype=float)
        if len(target) != len(self.names):
            raise TargetError(f"{len(target)} positions for {len(self.names)} joints: {', '.join(self.names)}")
        return np.array(target, dtype=float)

    def follow(self, trajectory: JointTrajectory | PiecewiseMotion) -> None:
        """Begin to follow a trajectory; it replaces one that is under way.

        Raises:
            GoalError: the controller has stopped, or the goal was rejected.
        """
        self._check_controller()
        message = self._message(trajectory) if isinstance(trajectory, PiecewiseMotion) else trajectory
        if message.points:
            held, end = self.state.desired[0], message.points[-1].positions
            last = dict(zip(message.joint_names, end, strict=False))
            self._target = np.array([last.get(name, held[j]) for j, name in enumerate(self.names)])
        if self._action is None:
            self._trajectories.publish(message)
            return
        goal = self._goal_type(trajectory=message)
        self._goal = self._answer(self._request(self._action.send_goal_async, goal), _TO_REST)
        if not self._goal.accepted:
            raise GoalError("the goal was rejected (the log of the node has the reason)")
        self._result = self._request(self._goal.get_result_async)

    def _message(self, motion: PiecewiseMotion) -> JointTrajectory:
        """The motion as quintics between its segments, which are the same."""
        message, state = JointTrajectory(joint_names=list(self.names)), np.zeros((3, len(self.names)))
        for time_ in motion.times[1:]:
            motion.evaluate(float(time_) - 1e-12, state)
            if time_ == motion.times[-1]:
                state[1:] = 0.0
            fields = dict(zip(("positions", "velocities", "accelerations"), state.tolist(), strict=True))
            point = JointTrajectoryPoint(**fields)
            due = point.time_from_start
            due.sec, due.nanosec = divmod(round(float(time_) * NANOSECONDS), NANOSECONDS)
            message.points.append(point)
        return message

    def wait(self, timeout: float) -> None:
        """Wait until the motion under way has ended, and the arm is there.

        Raises:
            GoalError: it was not completed; the message is that of the server.
            ArmError: it has not ended within `timeout`, s.
        """
        if self._result is not None:
            answer = self._answer(self._result, timeout, "the motion has not ended")
            self._result = None
            if answer.status == _CANCELED:
                raise GoalError("the motion was cancelled", answer.result.error_code)
            if answer.status != _SUCCESS:
                raise GoalError(answer.result.error_string, answer.result.error_code)
        elif self._target is not None:
            self._await(self._arrived, timeout, "the arm has not reached its goal (the log of the node has the reason)")
            self._target = None

    def _arrived(self) -> bool:
        self._check_controller()
        state = self.state
        there = self._target is None or np.abs(state.desired[0] - self._target).max() < _AT_REST
        return bool(there and np.abs(state.desired[1]).max() < _AT_REST)

    def stream(self, target: Sequence[float] | Array | Mapping[str, float]) -> None:
        """Send one target of a stream, see docs/streams.md; call it at 10 to 500 Hz.

        Args:
            target: as for `move_to`, shape (joints,), rad or m.

        Raises:
            TargetError: the number or the name of a joint is wrong.
        """
        names = list(target) if isinstance(target, Mapping) else list(self.names)
        self._posture(target, np.zeros(len(self.names)))
        positions = list(target.values()) if isinstance(target, Mapping) else [float(q) for q in target]
        message = JointState(name=names, position=positions)
        set_stamp(message.header.stamp, time.time_ns())
        self._targets.publish(message)

    def hold(self, wait: bool = True) -> None:
        """End the motion: come to rest as fast as the limits allow.

        Raises:
            ArmError: no node takes trajectories, or the reference is not at rest within 10 s.
        """
        if self._result is not None and self._goal is not None:
            self._answer(self._request(self._goal.cancel_goal_async), _TO_REST)
            self._result = None
        else:  # What is sent before the node is discovered is lost.
            self._await(self._trajectories.get_subscription_count, _TO_REST, "no node takes trajectories")
            self._trajectories.publish(JointTrajectory())
        self._target = None
        if wait:
            self._await(self._arrived, _TO_REST, "the reference has not come to rest")

    def _come_to_rest(self) -> None:
        """Hold the arm if it moves.

        Raises:
            GoalError: the controller has stopped.
        """
        self._check_controller()
        if np.abs(self.state.desired[1]).max() > _AT_REST:
            self.hold()

    def _check_controller(self) -> None:
        if fault := self.state.fault:
            raise GoalError(f"the controller has stopped: {fault}; call its ~/reset_fault")

    # The thread, and waiting for it.

    def _spin(self) -> None:
        while not self._closing:
            self._executor.spin_once(timeout_sec=0.1)

    def _on_state(self, data: bytes) -> None:
        self._state = data

    def _request(self, send: Callable[..., Future], *arguments: Any) -> Future:
        """Send a request of the action from the thread that takes the answers: rclpy drops one that comes at once."""
        sent = self._executor.create_task(send, *arguments)
        self._await(sent.done, _TO_REST, "the request was not sent")
        return sent.result()

    def _answer(self, future: Future, timeout: float, otherwise: str = "the system does not answer") -> Any:
        self._await(future.done, timeout, otherwise)
        return future.result()

    def _await(self, condition: Callable[[], Any], timeout: float, otherwise: str) -> None:
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                raise ArmError(f"{otherwise} within {timeout:g} s")
            time.sleep(_POLL)


def _value(value: Any) -> Any:
    """The value of a rcl_interfaces/ParameterValue; None if it is not set."""
    fields = {
        ParameterType.PARAMETER_BOOL: "bool_value",
        ParameterType.PARAMETER_INTEGER: "integer_value",
        ParameterType.PARAMETER_DOUBLE: "double_value",
        ParameterType.PARAMETER_STRING: "string_value",
        ParameterType.PARAMETER_DOUBLE_ARRAY: "double_array_value",
        ParameterType.PARAMETER_STRING_ARRAY: "string_array_value",
    }
    if value.type not in fields:
        return None
    found = getattr(value, fields[value.type])
    return list(found) if fields[value.type].endswith("array_value") else found
