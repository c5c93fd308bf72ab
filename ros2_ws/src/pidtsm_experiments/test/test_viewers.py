"""Layouts of RViz, Foxglove and PlotJuggler are readable, and their topics and fields exist."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml
from ament_index_python.packages import get_package_share_directory
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from pidtsm_experiments.bags.recorder_node import TOPICS
from two_link_sim.visualization_node import GHOST

SHARE = Path(get_package_share_directory("pidtsm_experiments"))
KNOWN = {f"/{topic}": kind for topic, kind in TOPICS.items()} | {
    "/robot_description": String,
    "/visualization/markers": MarkerArray,
}


def foxglove() -> dict[str, Any]:
    return json.loads((SHARE / "foxglove" / "two_link.json").read_text(encoding="utf-8"))


def rviz() -> dict[str, Any]:
    return yaml.safe_load((SHARE / "rviz" / "two_link.rviz").read_text(encoding="utf-8"))["Visualization Manager"]


def plotted() -> Iterator[tuple[str, str]]:
    """Topic and field of every curve of Foxglove and PlotJuggler."""
    for panel in foxglove()["configById"].values():
        for path in panel.get("paths", ()):
            topic, field = path["value"].split(".")
            yield topic, field
    for curve in ElementTree.parse(SHARE / "plotjuggler" / "two_link.xml").iter("curve"):
        topic, field = curve.attrib["name"].rsplit("/", 1)
        yield topic, field


def shown() -> Iterator[str]:
    """Topics of the 3D views."""
    for display in rviz()["Displays"]:
        for key in ("Topic", "Description Topic"):
            if key in display:
                yield display[key]["Value"]
    space = foxglove()["configById"]["3D!arm"]
    yield from space["topics"]
    for layer in space["layers"].values():
        yield layer["topic"]
        yield layer.get("jointStatesTopic", "/joint_states")


@pytest.mark.parametrize(("topic", "field"), sorted(set(plotted())))
def test_a_curve_is_a_field_of_a_topic(topic: str, field: str) -> None:
    matched = re.fullmatch(r"(\w+)(\[[01]\])?", field)
    assert matched
    name, index = matched.groups()
    kind = KNOWN[topic].get_fields_and_field_types()[name]
    assert kind == ("sequence<double>" if index else "double")


def test_3d_views_show_existing_topics() -> None:
    assert set(shown()) <= set(KNOWN)
    assert {d.get("TF Prefix") for d in rviz()["Displays"]} >= {"", GHOST}
    layers = foxglove()["configById"]["3D!arm"]["layers"].values()
    assert {layer["framePrefix"] for layer in layers} == {"", f"{GHOST}/"}


def test_foxglove_lays_out_every_panel() -> None:
    layout = foxglove()
    assert set(re.findall(r"\w+!\w+", json.dumps(layout["layout"]))) == set(layout["configById"])


def test_launch_remaps_what_rviz_shows() -> None:
    """Otherwise two systems in namespaces would be shown in one window."""
    text = (SHARE / "launch" / "two_link.launch.py").read_text(encoding="utf-8")
    remapped = re.search(r"^_VIEWED = \((.*)\)$", text, re.MULTILINE)
    assert remapped
    topics = {d[key]["Value"] for d in rviz()["Displays"] for key in ("Topic", "Description Topic") if key in d}
    assert set(re.findall(r'"(.*?)"', remapped[1])) == topics | {"/tf"}
