"""Two nodes that publish the same: who comes second is named, and none of its torques reaches the arm."""

import signal
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from testbed import Testbed

from pidtsm_experiments.runs import runner
from pidtsm_experiments.runs.runner import Process
from pidtsm_msgs.msg import ControllerState, JointReference

NAMES = ["joint1", "joint2"]
PATIENCE = "watchdog.state_stop:=1.0"
"""A machine that stalls for a moment is no rival."""


def second(testbed: Testbed, node: str) -> Process:
    """Another process of this node, beside the first, with the name ``second``."""
    arguments = ["-r", f"{node}:__node:=second", *(["-p", PATIENCE] if node == "controller" else [])]
    process = runner.Process(node, arguments, testbed.environment, testbed.folder / "second.log")
    testbed.processes.running["second"] = process
    return process


def says(testbed: Testbed, process: Process, text: str) -> None:
    testbed.spin_until(lambda: text in process.log.read_text(), f"{text!r} in the log of {process.name}")


def follows(testbed: Testbed, states: list[Any]) -> None:
    count = len(states)
    testbed.spin_until(
        lambda: len(states) > count + 100 and states[-1].mode == ControllerState.FOLLOWING, "the reference is followed"
    )


@pytest.mark.parametrize(("node", "topic"), [("controller", "/joint_commands"), ("trajectory", "/reference")])
def test_a_second_node_of_a_kind_is_named_and_publishes_nothing(testbed: Testbed, node: str, topic: str) -> None:
    first = {name: testbed.start(name) for name in ("simulator", "trajectory")}
    first["controller"] = testbed.start("controller", PATIENCE)
    states = testbed.hear(ControllerState, "controller/state")
    follows(testbed, states)
    applied = testbed.hear(JointState, "joint_states", 1000)
    count = len(states)
    rival = second(testbed, node)
    # Where it became active before it had discovered the first, it yields.
    testbed.spin_until(
        lambda: any(f"{word}activated: " in rival.log.read_text() for word in ("not ", "de")), "the second yields"
    )
    assert f"/{node}" in rival.log.read_text()
    says(testbed, first[node], f"/second has a publisher of {topic}, too; end one of them")
    follows(testbed, states)
    assert np.abs([state.position_error for state in states[count:]]).max() < 0.05
    assert np.abs(np.diff([state.effort for state in applied], axis=0)).max() < 20.0
    # It does not take over when the first ends.
    said = rival.log.read_text()
    first[node].interrupt()
    assert first[node].wait() == 0
    del testbed.processes.running[node]
    testbed.spin_until(lambda: testbed.node.count_publishers(topic) == 1, "the end of the first")
    assert "] [second]: active" not in rival.log.read_text()[len(said) :]


def test_two_controllers_that_start_together_agree_who_commands(testbed: Testbed) -> None:
    """The arm starts last: both become able to command it at the same moment."""
    both = [testbed.start("controller", PATIENCE), second(testbed, "controller")]
    for process in both:
        says(testbed, process, "not active yet: no joint state received yet")
    states, seconds = testbed.hear(ControllerState, "controller/state"), testbed.hear(ControllerState, "second/state")
    testbed.start("trajectory")
    testbed.start("simulator")
    testbed.spin_until(lambda: any("activated: " in process.log.read_text() for process in both), "one yields")
    follows(testbed, states if "activated: " in both[1].log.read_text() else seconds)


@pytest.mark.parametrize(
    ("kind", "topic", "witness"),
    [
        (JointState, "joint_commands", "controller"),
        (JointState, "joint_states", "controller"),
        (JointReference, "reference", "trajectory"),
    ],
)
def test_a_strangers_publisher_is_named_and_not_obeyed(testbed: Testbed, kind: Any, topic: str, witness: str) -> None:
    nodes = {name: testbed.start(name) for name in ("simulator", "trajectory")}
    nodes["controller"] = testbed.start("controller", PATIENCE)
    states, reports = testbed.hear(ControllerState, "controller/state"), testbed.hear(DiagnosticArray, "/diagnostics")
    follows(testbed, states)
    publisher = testbed.node.create_publisher(kind, topic, 10)
    count = len(states)

    def disturb() -> bool:
        """What the arm must not feel: a torque, a position or a reference that is far off, always up to date."""
        message = kind(name=NAMES, position=[1.0, 1.0])
        if topic == "joint_commands":
            message = kind(name=NAMES, effort=[100.0, -100.0])
        elif topic == "reference":
            message = kind(name=NAMES, position=[1.0, 1.0], velocity=[0.0, 0.0], acceleration=[0.0, 0.0])
        message.header.stamp = states[-1].header.stamp
        publisher.publish(message)
        return len(states) > count + 1000

    testbed.spin_until(disturb, "a second of disturbance")
    says(testbed, nodes[witness], f"/{topic}")
    assert "/stranger" in nodes[witness].log.read_text()
    reader = nodes["simulator" if topic == "joint_commands" else "controller"]
    says(testbed, reader, f"rejected {topic}: another node publishes this, too")
    assert any("/stranger" in status.message for report in reports for status in report.status)
    errors = np.array([state.position_error for state in states[count:]])
    assert np.abs(errors).max() < 0.05
    assert {state.mode for state in states[count:]} == {ControllerState.FOLLOWING}


def test_a_controller_that_was_killed_is_soon_replaced(testbed: Testbed) -> None:
    """Its publisher remains listed for 20 s."""
    for name in ("simulator", "trajectory"):
        testbed.start(name)
    killed = testbed.start("controller")
    follows(testbed, testbed.hear(ControllerState, "controller/state"))
    killed.process.send_signal(signal.SIGKILL)
    killed.wait()
    del testbed.processes.running["controller"]
    states = testbed.hear(ControllerState, "second/state")
    second(testbed, "controller")
    follows(testbed, states)
    assert testbed.node.count_publishers("joint_commands") == 2
