"""An arm that the project does not know, from its URDF: commands, nodes, bag, figures and report."""

import json
import os
import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from rcl_interfaces.srv import GetParameters
from std_msgs.msg import String
from support.testbed import Testbed

from pidtsm_core.experiment import PRACTICAL, make_experiment
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.cli import main
from pidtsm_ros.qos import KEPT

LINK = (
    '<link name="{0}"><inertial><origin xyz="0.1 0 0.05"/><mass value="{1}"/>'
    '<inertia ixx="0.02" iyy="0.03" izz="0.025" ixy="0" ixz="0.001" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="0.2 0 0.1" rpy="0.3 0 0.2"/>'
    '<axis xyz="{4}"/><limit effort="{5}" velocity="2" {6}/><dynamics damping="0.4" friction="0.2"/></joint>'
)
ARM = "".join(
    (
        '<robot name="crane"><link name="floor"/>',
        *(LINK.format(name, mass) for name, mass in (("mast", 6.0), ("boom", 3.0), ("hook", 1.0))),
        JOINT.format("slew", "continuous", "floor", "mast", "0 0 1", 60, ""),
        JOINT.format("lift", "prismatic", "mast", "boom", "0 0 1", 300, 'lower="-0.1" upper="0.5"'),
        JOINT.format("tilt", "revolute", "boom", "hook", "0 1 0.5", 30, 'lower="-1" upper="2"'),
        "</robot>",
    )
)
ROTORS = "controller.robot.armature=[0.2, 5.0, 0.1]", "simulator.robot.armature=[0.2, 5.0, 0.1]"
ROOT = Path(__file__).resolve().parents[1]
Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """A command in a folder with the arm: exit code, output and errors."""
    monkeypatch.chdir(tmp_path)
    Path("crane.urdf").write_text(ARM, encoding="utf-8")

    def call(*words: str) -> tuple[int, str, str]:
        rotors = [word for rotor in ROTORS for word in ("--set", rotor)]
        return main([*words, *rotors]), *capsys.readouterr()

    return call


def test_packages_of_the_user_are_found_through_the_launcher(tmp_path: Path) -> None:
    """``$(find)`` and ``package://`` of a workspace that the user has sourced."""
    prefix = tmp_path / "install" / "my_arm"
    share, index = prefix / "share" / "my_arm", prefix / "share" / "ament_index" / "resource_index" / "packages"
    for folder in (share, index):
        folder.mkdir(parents=True)
    (index / "my_arm").touch()
    (share / "crane.xacro").write_text(ARM.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"'))
    file = tmp_path / "mine.urdf.xacro"
    file.write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="mine">'
        '<xacro:include filename="$(find my_arm)/crane.xacro"/></robot>'
    )
    done = subprocess.run(
        [ROOT / "pidtsm", "rollout", "--robot", file, "--duration", "0.05", "--json"],
        env={**os.environ, "AMENT_PREFIX_PATH": str(prefix)},
        capture_output=True,
        text=True,
    )
    assert done.returncode in (0, 1), done.stderr
    assert json.loads(done.stdout)["joints"] == ["slew", "lift", "tilt"]


def test_it_tracks_in_a_rollout(call: Call) -> None:
    code, out, err = call("rollout", "--robot", "crane.urdf", "--params", "practical", "--json")
    assert code == 0, err
    metrics = json.loads(out)
    assert metrics["joints"] == ["slew", "lift", "tilt"]
    assert max(metrics["rmse"]) < 0.02


def test_it_runs_over_the_nodes_as_in_a_rollout(call: Call) -> None:
    code, _, err = call("run", "--robot", "crane.urdf", "--params", "practical", "--duration", "1", "--out", "out")
    assert code == 0, err
    recording = read_recording(Path("out/bag"))
    experiment = make_experiment(None, robot="crane.urdf", params=[PRACTICAL], overrides=ROTORS)
    np.testing.assert_array_equal(recording.effort, rollout(experiment, duration=1.0).effort)
    assert recording.joints == ("slew", "lift", "tilt")
    assert (recording.slides, recording.continuous) == ((False, True, False), (True, False, False))
    for result in ("figures/tracking.png", "params/controller.yaml"):
        assert Path("out", result).is_file()
    report = Path("out/report.html").read_text(encoding="utf-8")
    assert re.search(r'data-key="rmse" data-joint="1"[^>]*><data value="[^"]*" title="\S+ m">', report), "lift slides"
    assert '"sliding":[1]' in report  # The arm is animated.


def test_all_that_is_said_about_an_arm_reaches_the_nodes(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    """Joints, what is locked, limits, payload and arguments, from a stored arm."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(Path.cwd()))
    macro = ARM.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"').replace(
        '"6.0"', '"$(arg mass)"'
    )
    Path("crane.urdf.xacro").write_text(macro.replace("<link", '<xacro:arg name="mass"/><link', 1), encoding="utf-8")
    words = [
        "--joints",
        "slew,tilt",
        "--lock",
        "lift=0.2",
        "--effort",
        "tilt=25",
        "--payload",
        "0.5@0,0,0.1",
        "--xacro",
        "mass:=7",
    ]
    rotors = [word for node in ("controller", "simulator") for word in ("--set", f"{node}.robot.armature=0.2")]
    given = ["--params", "practical", "--duration", "0.5", *rotors, "--out", "out"]
    assert main(["run", "--robot", "crane.urdf.xacro", *words, "--save", "crane", *given]) == 0
    armature = {"robot.armature": 0.2}
    alone = rollout(robot="crane", params=PRACTICAL, duration=0.5, controller=armature, simulator=armature)
    recording = read_recording(Path("out/bag"))
    assert recording.joints == ("slew", "tilt")
    np.testing.assert_array_equal(recording.effort, alone.effort)
    known = {
        name: yaml.safe_load(Path(f"out/params/{name}.yaml").read_text("utf-8"))[f"/**/{name}"]["ros__parameters"]
        for name in ("controller", "simulator", "trajectory")
    }
    for parameters in known.values():
        assert parameters["robot"]["xacro"] == "mass:=7"
        assert parameters["robot"]["locked"] == "lift=0.2"
        assert parameters["limits"]["effort"] == [60.0, 25.0]


@pytest.mark.parametrize("node", ["simulator", "controller"])
def test_a_node_takes_its_arm_from_the_topic(testbed: Testbed, node: str) -> None:
    waiting = testbed.start(node, "robot.description:=topic")
    publisher = testbed.node.create_publisher(String, "robot_description", KEPT)
    testbed.spin_until(publisher.get_subscription_count, "the node waits for a description")
    assert waiting.process.poll() is None
    publisher.publish(String(data=ARM))
    request = GetParameters.Request(names=["joints", "robot.description", "limits.effort"])
    joints, description, effort = testbed.call(GetParameters, f"{node}/get_parameters", request).values
    assert joints.string_array_value == ["slew", "lift", "tilt"]
    assert description.string_value == ARM
    assert effort.double_array_value.tolist() == [60.0, 300.0, 30.0]


def test_a_node_that_waits_for_its_arm_ends_when_told(testbed: Testbed) -> None:
    waiting = testbed.start("controller", "robot.description:=topic")
    publisher = testbed.node.create_publisher(String, "robot_description", KEPT)
    testbed.spin_until(publisher.get_subscription_count, "the node waits for a description")
    waiting.interrupt()
    assert waiting.wait() == 0
    assert "Traceback" not in waiting.tail()


def test_a_broken_description_starts_nothing_and_is_one_line(call: Call) -> None:
    Path("crane.urdf").write_text(ARM.replace('type="prismatic"', 'type="planar"'), encoding="utf-8")
    for command in ("rollout", "run"):
        code, out, err = call(command, "--robot", "crane.urdf")
        assert (code, out) == (2, "")
        assert err.count("\n") == 1
        assert "joint lift: its type is planar" in err
    assert not Path("results").exists()
