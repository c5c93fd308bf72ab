"""Torques travel as JointState or, as ros2_control wants them, as Float64MultiArray."""

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from bench import Bench
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from pidtsm_core.experiment import make_experiment
from pidtsm_core.rollout import rollout
from pidtsm_msgs.msg import ControllerState
from pidtsm_ros.qos import RECORDER
from pidtsm_ros.stamps import nanoseconds


def record(bench: Bench, topic: str, message_type: Any, duration: float, *parameters: str) -> list[Any]:
    """Every message of the topic in a run in lockstep; parameters begin with the node's name and a colon."""
    given = {"controller": ["reference.match:=stamp"], "trajectory": ["clock:=lockstep"]}
    given["simulator"] = ["clock:=lockstep", f"duration:={duration}", "start.subscribers:=3"]
    for parameter in parameters:
        node, _, text = parameter.partition(":")
        given[node].append(text)
    processes = {node: bench.start(node, *texts) for node, texts in given.items()}
    messages: list[Any] = []
    subscription = bench.node.create_subscription(message_type, topic, messages.append, RECORDER)
    bench.spin_until(subscription.get_publisher_count, f"a publisher of {topic}")
    bench.node.create_subscription(JointState, "joint_commands", lambda message: None, 10)
    # The third that the simulator waits for.
    bench.node.create_subscription(JointState, "joint_states", lambda message: None, 10)
    simulator = processes["simulator"]
    bench.spin_until(lambda: simulator.process.poll() is not None, "the end of the run")
    assert simulator.process.returncode == 0, simulator.tail()
    return messages


@pytest.mark.parametrize("form", ["joint_state", "float64_multi_array"])
def test_the_loop_is_the_same_in_either_form(bench: Bench, form: str) -> None:
    forms = (f"controller:output.type:={form}", f"simulator:input.type:={form}")

    truth = record(bench, "simulator/ground_truth", JointState, 0.5, "controller:activation.blend:=0.0", *forms)

    bench.spin_until(lambda: len(truth) >= 500, "the ground truth")
    expected = rollout(make_experiment("case1", "piddtsm").settings, 0.5)
    np.testing.assert_array_equal([m.effort for m in truth], expected.effort)


def test_arrays_that_cannot_be_used_are_refused(bench: Bench) -> None:
    states: list[JointState] = []
    bench.node.create_subscription(JointState, "joint_states", states.append, 10)
    commands = bench.node.create_publisher(Float64MultiArray, "effort_controller/commands", 10)
    simulator = bench.start("simulator", "clock:=lockstep", "start.subscribers:=1", "input.type:=float64_multi_array")

    def says(text: str) -> bool:
        return text in simulator.log.read_text()

    bench.spin_until(lambda: states and commands.get_subscription_count(), "the first joint state")
    for values, cause in (
        ([1.0], "data has 1 values for 2 joints"),
        ([1.0, 2.0, 3.0], "data has 3 values for 2 joints"),
        ([1.0, math.nan], "data is not finite"),
        ([1e9, 0.0], "data is absurd"),
    ):
        commands.publish(Float64MultiArray(data=values))
        reason = f"rejected effort_controller/commands: {cause}"
        bench.spin_until(partial(says, reason), reason)
    assert len(states) == 1, "nothing of this moves the arm"
    commands.publish(Float64MultiArray(data=[1.0, 2.0]))
    bench.spin_until(lambda: len(states) > 1, "the next joint state")


def test_the_controllers_state_can_be_thinned_out(bench: Bench) -> None:
    parameters = ("controller:state.decimation:=10", "controller:start.subscribers:=2")
    states = record(bench, "controller/state", ControllerState, 0.2, *parameters)
    bench.spin_until(lambda: len(states) >= 20, "every tenth state")
    assert [nanoseconds(s.header.stamp) for s in states] == [k * 1_000_000 for k in range(0, 200, 10)]
