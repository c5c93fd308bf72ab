"""Torques travel as JointState or, as ros2_control wants them, as Float64MultiArray."""

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from support.testbed import Testbed

from pidtsm_core.experiment import make_experiment
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_msgs.msg import ControllerState
from pidtsm_ros.qos import RECORDER
from pidtsm_ros.stamps import nanoseconds


def record(testbed: Testbed, topic: str, message_type: Any, duration: float, *parameters: str) -> list[Any]:
    """Every message of the topic in a run in lockstep; parameters begin with the node's name and a colon."""
    given = {"controller": ["reference.match:=stamp"], "trajectory": ["clock:=lockstep"]}
    given["simulator"] = ["clock:=lockstep", f"duration:={duration}", "start.subscribers:=3"]
    for parameter in parameters:
        node, _, text = parameter.partition(":")
        given[node].append(text)
    processes = {node: testbed.start(node, *texts) for node, texts in given.items()}
    messages: list[Any] = []
    subscription = testbed.node.create_subscription(message_type, topic, messages.append, RECORDER)
    testbed.spin_until(subscription.get_publisher_count, f"a publisher of {topic}")
    testbed.node.create_subscription(JointState, "joint_commands", lambda message: None, 10)
    # The third that the simulator waits for.
    testbed.node.create_subscription(JointState, "joint_states", lambda message: None, 10)
    simulator = processes["simulator"]
    testbed.spin_until(lambda: simulator.process.poll() is not None, "the end of the run")
    assert simulator.process.returncode == 0, simulator.tail()
    return messages


@pytest.mark.parametrize("form", ["joint_state", "float64_multi_array"])
def test_the_loop_is_the_same_in_either_form(testbed: Testbed, form: str) -> None:
    forms = (f"controller:output.type:={form}", f"simulator:input.type:={form}")

    truth = record(testbed, "simulator/ground_truth", JointState, 0.5, "controller:activation.blend:=0.0", *forms)

    testbed.spin_until(lambda: len(truth) >= 500, "the ground truth")
    expected = rollout(make_experiment("case1", "piddtsm"), duration=0.5)
    np.testing.assert_array_equal([m.effort for m in truth], expected.effort)


def test_arrays_that_cannot_be_used_are_refused(testbed: Testbed) -> None:
    states: list[JointState] = testbed.hear(JointState, "joint_states")
    commands = testbed.node.create_publisher(Float64MultiArray, "effort_controller/commands", 10)
    simulator = testbed.start("simulator", "clock:=lockstep", "start.subscribers:=1", "input.type:=float64_multi_array")

    def logged(text: str) -> bool:
        return text in simulator.log.read_text()

    testbed.spin_until(lambda: states and commands.get_subscription_count(), "the first joint state")
    for values, cause in (
        ([1.0], "data has 1 values for 2 joints"),
        ([1.0, 2.0, 3.0], "data has 3 values for 2 joints"),
        ([1.0, math.nan], "data is not finite"),
        ([1e9, 0.0], "data is absurd"),
    ):
        commands.publish(Float64MultiArray(data=values))
        reason = f"rejected effort_controller/commands: {cause}"
        testbed.spin_until(partial(logged, reason), reason)
    assert len(states) == 1, "nothing of this moves the arm"
    commands.publish(Float64MultiArray(data=[1.0, 2.0]))
    testbed.spin_until(lambda: len(states) > 1, "the next joint state")


def test_the_controllers_state_can_be_thinned_out(testbed: Testbed) -> None:
    parameters = ("controller:state.decimation:=10", "controller:start.subscribers:=2")
    states = record(testbed, "controller/state", ControllerState, 0.2, *parameters)
    testbed.spin_until(lambda: len(states) >= 20, "every tenth state")
    assert [nanoseconds(s.header.stamp) for s in states] == [k * 1_000_000 for k in range(0, 200, 10)]
