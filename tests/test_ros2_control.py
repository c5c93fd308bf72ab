"""The files of docs/ros2-control.md fit each other and our nodes."""

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml

from pidtsm_core.node_parameters import NODE_SCHEMAS
from pidtsm_core.parameters import resolve
from pidtsm_core.robots import find_robot

PAGE = Path(__file__).resolve().parents[1] / "docs" / "ros2-control.md"
FILES = dict(re.findall(r'^```\w+ title="([^"]+)"\n(.*?)^```$', PAGE.read_text(encoding="utf-8"), re.M | re.S))
JOINTS = list(find_robot({"robot.description": "panda"}).joints)


def parameters(file: str) -> dict[str, dict[str, Any]]:
    return {node: content["ros__parameters"] for node, content in yaml.safe_load(FILES[file]).items()}


def test_our_nodes_accept_their_parameters() -> None:
    ours = parameters("pidtsm.yaml")
    for node, given in ours.items():
        assert list(resolve(NODE_SCHEMAS[node], given, len(JOINTS))["joints"]) == JOINTS  # type: ignore[arg-type]
    assert ours["controller"]["output.type"] == "float64_multi_array"


def test_the_controllers_have_the_joints_of_our_nodes_in_their_order() -> None:
    theirs = parameters("ros2_controllers.yaml")
    for name in ("joint_state_broadcaster", "effort_controller"):
        assert theirs[name]["joints"] == JOINTS
        assert name in theirs["controller_manager"]
    assert theirs["effort_controller"]["interface_name"] == "effort"


def test_the_hardware_publishes_every_torque() -> None:
    hardware = ElementTree.fromstring(FILES["panda.ros2_control.xacro"])
    assert hardware.findtext(".//param[@name='trigger_joint_command_threshold']") == "-1"
    assert [place.get("name") for place in hardware.iterfind(".//command_interface")] == ["effort"]
