"""The controller node estimates what a simulated arm carries, and takes it over when it is called."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import InertiaStamped
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from pidtsm_controller.controller_node import ControllerNode
from pidtsm_core.arrays import Array
from pidtsm_core.experiment.node_parameters import controller_node_schema
from pidtsm_core.parameters import ParameterError, names, resolve
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema
from pidtsm_msgs.msg import JointReference
from pidtsm_ros.stamps import set_stamp

RATE, CARRIED = 200, 1.0
ARM = {"robot.description": "ur5"}
WORDS = (
    "robot.description:=ur5",
    "reference.match:=stamp",
    "activation.blend:=0.0",
    "watchdog.state_stop:=1.0",
    "estimator.name:=extended_state_observer",
    "estimator.bandwidth:=25.0",
    "law.disturbance_rejection:=true",
    "payload.observe:=true",
)


class Carrying:
    """A simulated arm that carries something and swings, in lockstep with the node."""

    def __init__(self, graph: Any) -> None:
        given = {**ARM, "rate": RATE, "payload.mass": CARRIED}
        self.robot = SimulatedRobot(resolve(simulator_schema, given, 6))
        self.middle = self.robot.state.arm.position.copy()
        self.names = list(names(resolve(simulator_schema, given, 6)["joints"]))
        self.graph = graph
        self.commands: list[JointState] = []
        self.estimates: list[InertiaStamped] = []
        self.efforts: list[Array] = []
        stranger = graph.stranger
        self.states = stranger.create_publisher(JointState, "joint_states", 10)
        self.references = stranger.create_publisher(JointReference, "reference", 10)
        stranger.create_subscription(JointState, "joint_commands", self.commands.append, 10)
        stranger.create_subscription(InertiaStamped, "controller/payload", self.estimates.append, 10)
        self.sample = 0

    def send(self) -> None:
        """Publish the arm's present position, and where it should be."""
        time = self.sample / RATE
        angle = 2.0 * np.pi * 0.25 * time
        rate = 2.0 * np.pi * 0.25
        swing = 0.3 * np.array([1.0 - np.cos(angle), rate * np.sin(angle), rate**2 * np.cos(angle)])
        reference = JointReference(name=self.names)
        reference.position = (self.middle + swing[0]).tolist()
        reference.velocity, reference.acceleration = [swing[1]] * 6, [swing[2]] * 6
        state = JointState(name=self.names, position=self.robot.state.arm.position.tolist())
        for publisher, message in ((self.references, reference), (self.states, state)):
            set_stamp(message.header.stamp, self.sample * 1_000_000_000 // RATE)
            publisher.publish(message)

    def run(self, samples: int) -> None:
        """Move on, sample by sample."""
        for _ in range(samples):
            self.robot.sense(self.sample)
            answered = len(self.commands)
            self.send()
            self.graph.until(lambda answered=answered: len(self.commands) > answered)
            self.efforts.append(np.array(self.commands[-1].effort))
            self.robot.act(self.sample, True, self.efforts[-1])
            self.sample += 1


def test_what_is_carried_is_estimated_and_taken_over_only_when_called(graph: Callable[..., Any]) -> None:
    made = graph(ControllerNode, *WORDS)
    node, arm = made.node, Carrying(made)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: not node.refusal(), arm.send)
    assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    take = made.stranger.create_client(Trigger, "controller/take_payload")
    made.until(take.service_is_ready)
    made.until(lambda: made.stranger.count_publishers("joint_commands") == 1)

    def called() -> Any:
        future = take.call_async(Trigger.Request())
        made.until(future.done)
        return future.result()

    arm.run(20)
    assert "has not moved" in called().message
    arm.run(3 * RATE)
    assert arm.estimates[-1].inertia.m == pytest.approx(CARRIED, rel=0.05)
    assert node.values["payload.mass"] == 0.0
    refusal = called()
    assert not refusal.success
    assert "exceeds payload.largest, 0 kg" in refusal.message
    node.set_parameters([Parameter("payload.largest", value=5.0)])
    assert called().success
    assert "is being taken over" in called().message
    begun = len(arm.efforts)
    arm.run(RATE + RATE // 2)
    assert node.values["payload.mass"] == pytest.approx(CARRIED, rel=0.05)
    assert np.abs(np.diff(np.array(arm.efforts[begun - 5 :]), axis=0)).max() < 2.0


def test_the_payload_of_a_closed_form_cannot_be_observed() -> None:
    with pytest.raises(ParameterError, match=r"payload\.observe: two_link is a closed form"):
        controller_node_schema({"payload.observe": True})
