"""A controller node keeps what it has learnt from one activation to the next one."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rclpy.lifecycle import TransitionCallbackReturn
from sensor_msgs.msg import JointState

from pidtsm_controller.controller_node import ControllerNode
from pidtsm_core.control.state import Friction

LEARNS = (
    "reference.match:=stamp",
    "estimator.name:=extended_state_observer",
    "adaptation.friction:=learn",
    "adaptation.lateness:=learn",
)


def activated(graph: Callable[..., Any], path: Path) -> Any:
    """A node that is active, and would write and read this file."""
    made = graph(ControllerNode, *LEARNS, f"adaptation.file:={path}")
    states = made.stranger.create_publisher(JointState, "joint_states", 10)

    def send() -> None:
        states.publish(JointState(name=["joint1", "joint2"], position=[0.2, -0.1]))

    assert made.node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: not made.node.refusal(), send)
    assert made.node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    return made.node


def test_it_is_written_at_the_deactivation_and_read_at_the_next_activation(
    graph: Callable[..., Any], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "kept" / "learnt.json"
    node = activated(graph, path)
    assert not path.exists()
    node._controller.state.friction[Friction.EVIDENCE] = 0.25
    assert node.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
    content = json.loads(path.read_text(encoding="utf-8"))
    assert content["joints"] == ["joint1", "joint2"]
    assert content["friction"]["evidence"] == [0.25, 0.25]
    assert [each.name for each in path.parent.iterdir()] == ["learnt.json"]
    assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    assert (node._controller.state.friction[Friction.EVIDENCE] == 0.25).all()
    assert f"adaptation.file: continuing from {path}" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("content", "reason"),
    [("{", "Expecting property name"), ("{}", "not of the form"), ("[" * 100_000, "recursion"), (None, "directory")],
    ids=["no JSON", "other JSON", "deep JSON", "folder"],
)
def test_a_file_that_cannot_be_used_is_named_and_the_controller_begins_anew(
    graph: Callable[..., Any], tmp_path: Path, capfd: pytest.CaptureFixture[str], content: str | None, reason: str
) -> None:
    path = tmp_path / "learnt.json"
    if content is None:
        path.mkdir()
    else:
        path.write_text(content, encoding="utf-8")
    node = activated(graph, path)
    assert not node._controller.state.friction.any()
    said = capfd.readouterr().err
    assert f"adaptation.file: {path} is not used, and the controller begins anew" in said
    assert reason in said
