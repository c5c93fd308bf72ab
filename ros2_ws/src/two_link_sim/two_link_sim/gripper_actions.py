"""The actions of the gripper, as MoveIt and clients of ros2_control send them."""

from typing import Any

from control_msgs.action import GripperCommand, ParallelGripperCommand
from rclpy.action import GoalResponse
from rclpy.action.server import ServerGoalHandle
from sensor_msgs.msg import JointState

from pidtsm_core.parameters.joints import ABSURD, MessageError
from pidtsm_core.simulation.gripper import Gripper
from pidtsm_ros.action_server import KEPT, LoopActionServer
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.wire import deserialize

_FEEDBACK = 0.05
"""Time between two messages of feedback, s of simulated time."""
_MOST_KEPT = 100
"""Goals that are kept at once; each change of one publishes the status of all."""
_ACTIONS = {"gripper/gripper_cmd": GripperCommand, "gripper/parallel_gripper_cmd": ParallelGripperCommand}


class GripperActions:
    """Serves both actions; a new goal of either, or a trajectory, ends the one before."""

    def __init__(self, node: ManagedNode, gripper: Gripper) -> None:
        """Args: node: the simulator, while it is configured; gripper: of its arm."""
        self._node, self._gripper = node, gripper
        self._servers = {kind: self._serve(kind, name) for name, kind in _ACTIONS.items()}
        self._running: tuple[Any, ServerGoalHandle] | None = None  # type of the action, goal
        self._admitted: Any = None
        self._silent = 0.0  # s since the last feedback

    def advance(self, dt: float) -> None:
        """End the goal if it is reached, stalls or is cancelled, after the gripper has moved for dt (s)."""
        if self._running is None:
            return
        kind, handle = self._running
        if handle.is_cancel_requested:
            self._gripper.stop()
            handle.canceled()
        elif self._gripper.reached or self._gripper.stalled:
            handle.succeed()
        else:
            self._silent += dt
            if self._silent >= _FEEDBACK:
                self._silent = 0.0
                handle.publish_feedback(self._filled(kind, kind.Feedback()))
            return
        self._finish()

    def abort(self, reason: str) -> None:
        """End the goal, if there is one; the log has the reason."""
        if self._running is None:
            return
        _, handle = self._running
        self._node.get_logger().warning(f"goal of the gripper aborted: {reason}")
        if handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        self._finish()

    def _serve(self, kind: Any, name: str) -> LoopActionServer:
        server = LoopActionServer(
            self._node, kind, name, lambda goal: self._admit(kind, goal), lambda handle: self._accept(kind, handle)
        )
        self._node.own(server)
        return server

    def _admit(self, kind: Any, goal: Any) -> GoalResponse:
        """Reject what the gripper cannot do; a rejected goal has no result, so the log has the reason."""
        reason = ""
        if not self._node.active:
            reason = "the simulator is not active"
        elif self._servers[kind].kept >= _MOST_KEPT:
            reason = f"{_MOST_KEPT} goals have come within {KEPT} s; send them more slowly"
        try:
            content = deserialize(goal, kind.Goal) if isinstance(goal, bytes) else goal
            if not reason:
                self._begin(kind, content.command)
        except MessageError as error:
            reason = str(error)
        if reason:
            self._node.get_logger().error(f"goal of the gripper rejected: {reason}")
        return GoalResponse.REJECT if reason else GoalResponse.ACCEPT

    def _begin(self, kind: Any, command: Any) -> None:
        """Begin the motion.

        Raises:
            MessageError: see `Gripper.follow`, or the effort is not finite.
        """
        single = kind is GripperCommand
        efforts = [command.max_effort] if single else list(command.effort)
        if not all(abs(effort) < ABSURD for effort in efforts):
            raise MessageError("the effort is not finite, or absurd")
        if single:
            self._gripper.close_to(command.position)
        else:
            if len(command.position) != len(command.name):
                raise MessageError(f"position has {len(command.position)} values for {len(command.name)} joints")
            fastest = min(command.velocity, default=0.0)
            self._gripper.follow(command.name, [0.0], [list(command.position)], fastest)
        self._gripper.effort_limit = abs(max(efforts, default=0.0))

    def _accept(self, kind: Any, handle: ServerGoalHandle) -> None:
        self.abort("preempted by a new goal")
        handle.execute()
        self._running, self._silent = (kind, handle), 0.0

    def _finish(self) -> None:
        assert self._running is not None
        (kind, handle), self._running = self._running, None
        result = self._filled(kind, kind.Result())
        result.stalled, result.reached_goal = self._gripper.stalled, self._gripper.reached
        self._servers[kind].finish(handle, result)

    def _filled(self, kind: Any, message: Any) -> Any:
        """A result or feedback with the present state."""
        gripper = self._gripper
        effort = gripper.effort_limit if gripper.stalled else 0.0
        if kind is GripperCommand:
            message.position, message.effort = float(gripper.position[gripper.leader]), effort
            message.stalled, message.reached_goal = gripper.stalled, gripper.reached
        else:
            message.state = JointState(
                name=list(gripper.joints),
                position=gripper.position.tolist(),
                velocity=gripper.velocity.tolist(),
                effort=[effort] * len(gripper.joints),
            )
        return message
