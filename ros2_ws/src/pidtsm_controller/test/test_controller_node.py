"""When the controller node becomes active, why it refuses to, and its topics after clean-up."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

from pidtsm_controller.controller_node import ControllerNode
from pidtsm_core.experiment.node_parameters import controller_node_schema
from pidtsm_msgs.msg import ControllerState, JointReference

NAMES = ["joint1", "joint2"]
LOCKSTEP = "reference.match:=stamp"
MS = 1_000_000


class Arm:
    """Publishes joint states and references of equal stamps, 1 ms apart."""

    def __init__(self, graph: Any, position: list[float], desired: list[float]) -> None:
        self.states = graph.stranger.create_publisher(JointState, "joint_states", 10)
        self.references = graph.stranger.create_publisher(JointReference, "reference", 10)
        self.position, self.desired = position, desired
        self.effort: list[float] = []
        self.sample = 0

    def send(self) -> None:
        rest = [0.0] * len(NAMES)
        state = JointState(name=NAMES, position=self.position)
        motion = {"position": self.desired, "velocity": rest, "acceleration": rest}
        reference = JointReference(name=NAMES, **motion, effort=self.effort)
        for publisher, message in ((self.references, reference), (self.states, state)):
            message.header.stamp.nanosec = self.sample * MS
            publisher.publish(message)
        self.sample += 1


def test_it_declares_every_parameter_of_its_schema(graph: Callable[..., Any]) -> None:
    node = graph(ControllerNode, LOCKSTEP).node
    assert {p.name for p in controller_node_schema({})} == node.values.keys()
    assert all(node.get_parameter(name).value is not None for name in node.values)


def test_without_a_joint_state_it_does_not_become_active(
    graph: Callable[..., Any], capfd: pytest.CaptureFixture[str]
) -> None:
    node = graph(ControllerNode, LOCKSTEP).node
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node.refusal() == "no joint state received yet"
    assert node.trigger_activate() == TransitionCallbackReturn.FAILURE
    assert not node.active
    assert "not activated: no joint state received yet" in capfd.readouterr().err


REFUSAL = (
    "joint1 is 0.2 rad from its reference (activation.distance 0.1); trajectory/go_to_arm brings the reference there"
)


@pytest.mark.parametrize(("desired", "refusal"), [(0.4, REFUSAL), (0.21, "")])
def test_it_becomes_active_only_near_its_reference(
    graph: Callable[..., Any], capfd: pytest.CaptureFixture[str], desired: float, refusal: str
) -> None:
    made = graph(ControllerNode, LOCKSTEP, "activation.distance:=0.1")
    node, arm = made.node, Arm(made, [0.2, -0.1], [desired, -0.1])
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: node.refusal() == refusal, arm.send)
    expected = TransitionCallbackReturn.FAILURE if refusal else TransitionCallbackReturn.SUCCESS
    assert node.trigger_activate() == expected
    assert node.active is not bool(refusal)
    assert (f"not activated: {refusal}" in capfd.readouterr().err) is bool(refusal)


def test_the_effort_of_a_reference_is_added_to_the_command_and_may_be_empty(graph: Callable[..., Any]) -> None:
    made = graph(ControllerNode, LOCKSTEP, "activation.blend:=0.0")
    node, arm = made.node, Arm(made, [0.2, -0.1], [0.2, -0.1])
    commands: list[JointState] = []
    made.stranger.create_subscription(JointState, "joint_commands", commands.append, 10)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: not node.refusal(), arm.send)
    assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: made.stranger.count_publishers("joint_commands") == 1)

    def command() -> Any:
        arm.send()
        made.until(lambda: commands and commands[-1].header.stamp.nanosec == (arm.sample - 1) * MS)
        return np.array(commands[-1].effort)

    still = command()
    for effort in ([7.0, -3.0], [], [7.0, -3.0]):
        arm.effort = effort
        np.testing.assert_allclose(command(), still + (effort or 0.0), atol=1e-9)
    for count, effort in enumerate(([7.0], [7.0, math.nan]), 1):
        arm.effort = effort
        arm.send()
        made.until(lambda count=count: node.rejected == count)
    arm.effort = []
    np.testing.assert_allclose(command(), still, atol=1e-9)


def test_freedrive_and_hold_are_services_and_report_why_they_refuse(graph: Callable[..., Any]) -> None:
    made = graph(ControllerNode, LOCKSTEP, "activation.distance:=0.1")
    node, arm = made.node, Arm(made, [0.2, -0.1], [0.2, -0.1])
    states: list[ControllerState] = []
    made.stranger.create_subscription(ControllerState, "controller/state", states.append, 10)
    made.stranger.create_subscription(JointState, "joint_commands", lambda message: None, 10)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    switches = {name: made.stranger.create_client(SetBool, f"controller/{name}") for name in ("freedrive", "hold")}

    def call(name: str, on: bool) -> str:
        made.until(switches[name].service_is_ready)
        answer = switches[name].call_async(SetBool.Request(data=on))
        made.until(answer.done)
        assert answer.result().success is (answer.result().message == "")
        return str(answer.result().message)

    def mode() -> int:
        arm.send()
        made.until(lambda: states and states[-1].header.stamp.nanosec == (arm.sample - 1) * MS)
        return int(states[-1].mode)

    assert call("freedrive", True) == "the controller is inactive"
    made.until(lambda: not node.refusal(), arm.send)
    assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: made.stranger.count_publishers("controller/state") == 1)
    assert mode() == ControllerState.FOLLOWING
    for name, on, expected in (
        ("freedrive", True, ControllerState.FREEDRIVE),
        ("freedrive", False, ControllerState.HOLDING),
        ("hold", False, ControllerState.FOLLOWING),
        ("hold", True, ControllerState.HOLDING),
    ):
        assert call(name, on) == ""
        assert mode() == expected
    arm.desired = [0.4, -0.1]
    mode()
    assert call("hold", False) == REFUSAL
    assert mode() == ControllerState.HOLDING


def test_in_realtime_an_old_joint_state_does_not_activate_it(graph: Callable[..., Any]) -> None:
    made = graph(ControllerNode, "watchdog.state_stop:=0.01", "realtime.priority:=0")
    node, arm = made.node, Arm(made, [0.2, -0.1], [0.2, -0.1])
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: node.refusal() != "no joint state received yet", arm.send)
    made.until(lambda: "s ago (watchdog.state_stop)" in node.refusal())
    assert node.trigger_activate() == TransitionCallbackReturn.FAILURE


def test_cleaned_up_it_leaves_no_topics(graph: Callable[..., Any]) -> None:
    made = graph(ControllerNode, LOCKSTEP)
    assert made.node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: made.stranger.count_publishers("joint_commands") == 1)
    assert made.node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: made.stranger.count_publishers("joint_commands") == 0)
    assert made.stranger.count_subscribers("joint_states") == 0
