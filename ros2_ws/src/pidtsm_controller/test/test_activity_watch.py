"""What the controller manager of ros2_control reports decides whether the controller may be active."""

from collections.abc import Callable
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from sensor_msgs.msg import JointState

from pidtsm_controller.controller_node import ControllerNode

TROUBLE = "manager reports that effort_controller is inactive: activate it, then this node"


class Manager:
    """A controller manager, and the joint states that its broadcaster publishes."""

    def __init__(self, graph: Any, key: str = "effort_controller.state") -> None:
        self._key = key
        self._diagnostics = graph.stranger.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._states = graph.stranger.create_publisher(JointState, "joint_states", 10)

    def report(self, state: str) -> None:
        values = [KeyValue(key="joint_state_broadcaster.state", value="active"), KeyValue(key=self._key, value=state)]
        others = DiagnosticStatus(name="controller_manager: Hardware Components Activity")
        status = DiagnosticStatus(name="manager: Controllers Activity", values=values)
        self._diagnostics.publish(DiagnosticArray(status=[others, status]))

    def send(self) -> None:
        self._states.publish(JointState(name=["joint1", "joint2"], position=[0.0, 0.0]))


def configured(graph: Callable[..., Any]) -> tuple[Any, ControllerNode, Manager]:
    made = graph(ControllerNode, "output.type:=float64_multi_array", "watchdog.state_stop:=60.0")
    assert made.node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    manager = Manager(made)
    made.until(lambda: "no joint state" not in made.node.refusal(), manager.send)
    return made, made.node, manager


@pytest.mark.parametrize("key", ["effort_controller.state", "effort_controller"])
def test_it_becomes_active_only_when_its_torques_are_applied(graph: Callable[..., Any], key: str) -> None:
    made, node, _ = configured(graph)
    manager = Manager(made, key)
    made.until(lambda: node.refusal() == TROUBLE, lambda: manager.report("inactive"))
    assert node.trigger_activate() == TransitionCallbackReturn.FAILURE
    made.until(lambda: not node.refusal(), lambda: manager.report("active"))
    assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS


def test_it_deactivates_itself_when_they_are_applied_no_more(
    graph: Callable[..., Any], capfd: pytest.CaptureFixture[str]
) -> None:
    made, node, manager = configured(graph)
    watch = node._activity
    assert watch is not None
    # It may be about to become active: one report is not enough.
    assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: watch._state == "inactive", lambda: manager.report("inactive"))
    manager.report("active")
    made.until(lambda: watch._state == "active")
    assert node.active
    manager.report("inactive")
    made.until(lambda: not node.active)
    assert f"deactivated, because no torque reaches the arm: {TROUBLE}" in capfd.readouterr().err


def test_it_believes_no_report_that_may_be_of_another_arms_manager(graph: Callable[..., Any]) -> None:
    made, node, manager = configured(graph)
    made.until(lambda: node.refusal() == TROUBLE, lambda: manager.report("inactive"))
    namesakes = [Node("manager", namespace=arm, use_global_arguments=False) for arm in ("left", "right")]
    for namesake in namesakes:
        namesake.create_publisher(DiagnosticArray, "/diagnostics", 10)
    made.until(lambda: not node.refusal(), lambda: manager.report("inactive"))
    for namesake in namesakes:
        namesake.destroy_node()
