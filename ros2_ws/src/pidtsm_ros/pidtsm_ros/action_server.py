"""An action server whose goals the loop of a node executes."""

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from pidtsm_ros.serialized_goals import serialized_request

KEPT = 10
"""Time for which the result of a goal is kept, s."""


class LoopActionServer(ActionServer):
    """Takes goals as bytes, and the result of a goal when it is known.

    For the result, rclpy would run a coroutine for each goal, and the events executor resumes pending ones without a
    pause.
    """

    _is_goal_request_ready: bool

    def __init__(
        self,
        node: Node,
        action_type: Any,
        name: str,
        admit: Callable[[Any], GoalResponse],
        accept: Callable[[ServerGoalHandle], None],
    ) -> None:
        """Create the action.

        Args:
            node: its node.
            action_type: generated type of the action.
            name: of the action.
            admit: decides whether a goal is accepted. It gets the goal as bytes, or as an object if this rclpy gives no
                bytes.
            accept: called with each goal that was accepted; it must call `ServerGoalHandle.execute`.
        """
        self._request = serialized_request(action_type)
        super().__init__(
            node,
            action_type,
            name,
            execute_callback=lambda _: None,
            goal_callback=admit,
            handle_accepted_callback=accept,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            result_timeout=KEPT,
        )

    def take_data(self) -> dict[str, Any]:
        """See `ActionServer.take_data`; the goal of the request is serialized."""
        if self._request is None or not self._is_goal_request_ready:
            return dict(super().take_data())
        with self._lock:
            taken = self._handle.take_goal_request(self._request)
        self._is_goal_request_ready = False
        data = dict(super().take_data())
        return {"goal": taken, **data} if all(taken) else data

    @property
    def kept(self) -> int:
        """Number of goals that the server knows, with those that have ended within `KEPT`."""
        return len(self._goal_handles)

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:
        """The loop of the node executes goals."""

    def finish(self, goal_handle: ServerGoalHandle, result: Any) -> None:
        """Send the result of a goal whose status is final."""
        super().notify_execute(goal_handle, lambda _: result)
