"""Layouts of RViz, Foxglove and PlotJuggler are readable, their topics and fields exist, and they serve any arm."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml
from ament_index_python.packages import get_package_share_directory
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from pidtsm_core.robots import NAMES, find_robot
from pidtsm_experiments.bags.recorder_node import TOPICS
from two_link_sim.drawing import GHOST

SHARE = Path(get_package_share_directory("pidtsm_experiments"))
KNOWN = {f"/{topic}": kind for topic, kind in TOPICS.items()} | {
    "/robot_description": String,
    "/visualization/markers": MarkerArray,
}


def foxglove() -> dict[str, Any]:
    return json.loads((SHARE / "foxglove" / "arm.json").read_text(encoding="utf-8"))


def rviz(name: str = "arm") -> dict[str, Any]:
    return yaml.safe_load((SHARE / "rviz" / f"{name}.rviz").read_text(encoding="utf-8"))["Visualization Manager"]


def plots() -> Iterator[list[tuple[str, str]]]:
    """Topic and field of every curve, by plot of Foxglove and PlotJuggler."""
    for panel in foxglove()["configById"].values():
        yield [_halves(path["value"], ".") for path in panel.get("paths", ())]
    for plot in ElementTree.parse(SHARE / "plotjuggler" / "arm.xml").iter("plot"):
        yield [_halves(curve.attrib["name"], "/") for curve in plot.iter("curve")]


def _halves(path: str, separator: str) -> tuple[str, str]:
    topic, _, field = path.rpartition(separator)
    return topic, field


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


def test_a_curve_is_a_field_of_a_topic() -> None:
    """Of PlotJuggler's joint states, the fields have the names of joints, so no curve is one of those."""
    for topic, field in (curve for plot in plots() for curve in plot):
        matched = re.fullmatch(r"(\w+)(\[\d\])?", field)
        assert matched, field
        name, index = matched.groups()
        kind = KNOWN[topic].get_fields_and_field_types()[name]
        assert kind == ("sequence<double>" if index else "double"), f"{topic} {field}"
        assert topic != "/joint_states"


def test_plots_have_a_curve_for_every_joint_of_every_arm() -> None:
    joints = max(len(find_robot({"robot.description": name}).joints) for name in NAMES)
    for plot in plots():
        series = {(topic, field.partition("[")[0]) for topic, field in plot if "[" in field}
        assert {curve for curve in plot if "[" in curve[1]} == {
            (topic, f"{name}[{i}]") for topic, name in series for i in range(joints)
        }


def test_3d_views_show_existing_topics() -> None:
    assert set(shown()) <= set(KNOWN)
    assert {d.get("TF Prefix") for d in rviz()["Displays"]} >= {"", GHOST}
    layers = foxglove()["configById"]["3D!arm"]["layers"].values()
    assert {layer["framePrefix"] for layer in layers} == {"", f"{GHOST}/"}


def test_one_rviz_shows_both_arms_with_the_prefixes_of_the_launch_file() -> None:
    """RViz adds the slash to a prefix itself."""

    def displays(name: str) -> list[tuple[str, str]]:
        found = [d for d in rviz(name)["Displays"] if "Grid" not in d["Class"]]
        return [((d.get("Topic") or d["Description Topic"])["Value"], d.get("TF Prefix", "-")) for d in found]

    expected = [
        (f"/{side}{topic}", prefix if prefix == "-" else "/".join(filter(None, (side, prefix))))
        for side in ("left", "right")
        for topic, prefix in displays("arm")
    ]
    assert displays("two_arms") == expected
    text = (SHARE / "launch" / "two_arms.launch.py").read_text(encoding="utf-8")
    assert '_SIDES = {"left": ' in text


def test_foxglove_lays_out_every_panel() -> None:
    layout = foxglove()
    assert set(re.findall(r"\w+!\w+", json.dumps(layout["layout"]))) == set(layout["configById"])


def test_launch_remaps_what_rviz_shows() -> None:
    """Otherwise two systems in namespaces would be shown in one window."""
    text = (SHARE / "launch" / "arm.launch.py").read_text(encoding="utf-8")
    remapped = re.search(r"^_VIEWED = \((.*)\)$", text, re.MULTILINE)
    assert remapped
    topics = {d[key]["Value"] for d in rviz()["Displays"] for key in ("Topic", "Description Topic") if key in d}
    assert set(re.findall(r'"(.*?)"', remapped[1])) == topics | {"/tf"}
