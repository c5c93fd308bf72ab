"""The controller node publishes the wrench on the tool of a simulated arm that is pushed."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.lifecycle import TransitionCallbackReturn
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from pidtsm_controller.controller_node import ControllerNode
from pidtsm_core.arrays import Array
from pidtsm_core.experiment.node_parameters import controller_node_schema
from pidtsm_core.parameters import ParameterError, names, resolve
from pidtsm_core.robots import find_robot
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema
from pidtsm_core.trajectories.tool import tool_pose
from pidtsm_msgs.msg import JointReference
from pidtsm_ros.stamps import set_stamp

RATE = 200
ARM = {"robot.description": "ur5"}
START = np.array([0.0, -1.2, 1.8, -2.2, -1.57, 0.0])
WORDS = (
    "robot.description:=ur5",
    "reference.match:=stamp",
    "estimator.name:=extended_state_observer",
    "estimator.bandwidth:=25.0",
    "law.disturbance_rejection:=true",
    "external_wrench.publish:=true",
)
PUSH = np.array([10.0, -5.0, 8.0, 0.5, -1.0, 0.8])
"""In the axes of the base, N and N m."""


class Pushed:
    """A simulated arm that should stay where it is, in lockstep with the node."""

    def __init__(self, graph: Any) -> None:
        given = resolve(simulator_schema, {**ARM, "rate": RATE, "initial_position": START.tolist()}, 6)
        self.robot, self.names = SimulatedRobot(given), list(names(given["joints"]))
        _, self.axes = tool_pose(find_robot(ARM), given, START)
        self.graph, self.sample = graph, 0
        self.commands: list[JointState] = []
        self.wrenches: list[WrenchStamped] = []
        self.states = graph.stranger.create_publisher(JointState, "joint_states", 10)
        self.references = graph.stranger.create_publisher(JointReference, "reference", 10)
        graph.stranger.create_subscription(JointState, "joint_commands", self.commands.append, 10)
        graph.stranger.create_subscription(WrenchStamped, "controller/external_wrench", self.wrenches.append, 10)

    def send(self) -> None:
        zeros = [0.0] * 6
        reference = JointReference(name=self.names, position=START.tolist(), velocity=zeros, acceleration=zeros)
        state = JointState(name=self.names, position=self.robot.state.arm.position.tolist())
        for publisher, message in ((self.references, reference), (self.states, state)):
            set_stamp(message.header.stamp, self.sample * 1_000_000_000 // RATE)
            publisher.publish(message)

    def run(self, samples: int) -> Array:
        """Move on; the last wrench, in the axes of the base, shape (6,)."""
        for _ in range(samples):
            self.robot.sense(self.sample)
            answered = len(self.commands)
            self.send()
            self.graph.until(lambda answered=answered: len(self.commands) > answered)
            self.robot.act(self.sample, True, np.array(self.commands[-1].effort))
            self.sample += 1
        self.graph.until(lambda: self.wrenches)
        f, t = self.wrenches[-1].wrench.force, self.wrenches[-1].wrench.torque
        return np.concatenate([self.axes @ [f.x, f.y, f.z], self.axes @ [t.x, t.y, t.z]])


def test_a_push_on_the_tool_is_published_and_can_be_made_zero(graph: Callable[..., Any]) -> None:
    made = graph(ControllerNode, *WORDS)
    node, arm = made.node, Pushed(made)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: not node.refusal(), arm.send)
    assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    zero = made.stranger.create_client(Trigger, "controller/zero_external_wrench")
    made.until(zero.service_is_ready)
    made.until(lambda: made.stranger.count_publishers("joint_commands") == 1)
    np.testing.assert_allclose(arm.run(RATE // 2), 0.0, atol=0.5)
    arm.robot.push(PUSH)
    np.testing.assert_allclose(arm.run(RATE), PUSH, atol=0.5)
    assert arm.wrenches[-1].header.frame_id == "tool"
    called = zero.call_async(Trigger.Request())
    made.until(called.done)
    assert called.result().success
    np.testing.assert_allclose(arm.run(RATE // 4), 0.0, atol=0.5)
    arm.robot.push(np.zeros(6))
    np.testing.assert_allclose(arm.run(RATE), -PUSH, atol=0.5)


def test_without_an_estimate_there_is_no_wrench() -> None:
    with pytest.raises(ParameterError, match=r"external_wrench\.publish needs limits\.external_effort, which is 0"):
        controller_node_schema({**ARM, "external_wrench.publish": True, "limits.external_effort": 0.0})
