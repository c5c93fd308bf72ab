"""Which arm: the content of a definition reaches the parameters, a file and back."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.parameters import resolve
from pidtsm_core.robots import find_robot
from pidtsm_core.robots.definition import (
    ArmDefinition,
    GripperLockedWarning,
    check_name,
    file_content,
    find_arm,
    joints_sentence,
)
from pidtsm_core.robots.source import read_source
from pidtsm_core.robots.stored import arms_folder, stored_file, stored_names
from pidtsm_core.rollouts.closed_loop import rollout

NAME = "panda"
JOINTS = ("panda_joint4", "panda_joint2", "panda_joint6")
ARM = ArmDefinition(
    NAME,
    joints=JOINTS,
    locked={"panda_joint1": 0.3},
    effort={"panda_joint6": 9.0},
    payload=1.5,
    center_of_mass=(0.0, 0.0, 0.1),
)
XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="mass"/><xacro:arg name="length" default="0.5"/><link name="base"/>
<link name="rod"><inertial><origin xyz="$(arg length) 0 0"/><mass value="$(arg mass)"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="swing" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="90" velocity="2"/></joint>
<link name="end"><inertial><mass value="$(arg mass)"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<joint name="bend" type="revolute"><parent link="rod"/><child link="end"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="90" velocity="2"/></joint>
</robot>"""
FINGER = """<link name="finger"><inertial><mass value="0.1"/>
<inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="grip" type="prismatic"><parent link="end"/><child link="finger"/>
<limit lower="0" upper="0.03" effort="9" velocity="1"/></joint></robot>"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the test, with the user's configuration and a xacro file in it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "configuration"))
    Path("arm.urdf.xacro").write_text(XACRO, encoding="utf-8")
    return tmp_path


def store(name: str, text: str) -> None:
    arms_folder().mkdir(parents=True, exist_ok=True)
    stored_file(name).write_text(text, encoding="utf-8")


def test_everything_reaches_the_parameters_of_both_nodes() -> None:
    settings = make_experiment(None, robot=ARM).values
    for node in ("simulator", "controller"):
        values = settings[node]
        assert values["joints"] == JOINTS
        assert values["limits.effort"] == (87.0, 87.0, 9.0)
        assert values["robot.locked"] == "panda_joint1=0.3"
        assert (values["payload.mass"], values["payload.center_of_mass"]) == (1.5, (0.0, 0.0, 0.1))
        assert find_robot(values).joints == JOINTS
    assert settings["trajectory"]["joints"] == JOINTS


def test_a_stored_arm_is_the_same_arm() -> None:
    store("mine", file_content(ARM))
    assert find_arm("mine") == replace(ARM, name="mine")
    given, stored = (rollout(robot=robot, duration=0.05) for robot in (ARM, "mine"))
    np.testing.assert_array_equal(given.effort, stored.effort)


@pytest.mark.parametrize("robot", ["panda", "arm.urdf", "topic", "<robot/>"])
def test_a_name_or_path_alone_means_nothing_more(robot: str) -> None:
    store("arm.urdf", "description: panda")  # No name that --save takes.
    store("panda", "description: ur5")
    assert find_arm(robot) == ArmDefinition(robot)
    assert stored_names() == ("panda",)


def test_a_long_text_is_a_description_and_no_path() -> None:
    text = read_source("panda")[1]
    assert ArmDefinition(text).settings()["robot.description"] == text


def test_a_payload_is_a_part_of_the_description_for_identification() -> None:
    values = resolve(controller_schema, ARM.settings(), len(JOINTS))
    np.testing.assert_array_equal(ARM.described().tree, Controller(values).config.model.parameters)


def test_xacro_arguments_reach_the_model() -> None:
    masses = {}
    for mass in ("2", "3"):
        arm = ArmDefinition("arm.urdf.xacro", xacro={"mass": mass})
        values = make_experiment(None, robot=arm).values["simulator"]
        masses[mass] = find_robot(values).pack_model(values)
    assert not np.array_equal(masses["2"], masses["3"])
    assert 'mass value="2"' in read_source("arm.urdf.xacro", (("mass", "2"),))[1]


@pytest.mark.parametrize(
    ("arm", "cause"),
    [
        (ArmDefinition("arm.urdf.xacro"), "its argument mass has no value; give it with --xacro mass:=VALUE"),
        (ArmDefinition("arm.urdf.xacro", xacro={"mass": "1", "mas": "1"}), "no argument mas; it has length, mass"),
        (ArmDefinition("panda", xacro={"mass": "1"}), "only a xacro file has arguments, such as mass:=1"),
        (ArmDefinition("two_link", locked={"joint1": 0.0}), "two_link is a closed form, without locked joints"),
        (ArmDefinition("two_link", payload=1.0, center_of_mass=(0.1, 0.0, 0.0)), "a point mass at its tool"),
        (ArmDefinition("scara", effort=(1.0, 2.0)), "2 limits for 4 joints, joint1, joint2, joint3, joint4"),
        (ArmDefinition("scara", effort={"joint5": 2.0}), "no joint joint5 moves; .*did you mean joint"),
        (ArmDefinition("scara", joints=("joint1", "knee")), "no movable joint knee"),
        (ArmDefinition("scra"), "neither a file nor one of two_link, .*, mine; did you mean scara"),
    ],
)
def test_what_an_arm_cannot_have_is_refused(arm: ArmDefinition, cause: str) -> None:
    store("mine", "description: panda")
    with pytest.raises(UsageError, match=cause) as refusal:
        make_experiment(None, robot=arm)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "text",
    [
        "joints: [a]",
        "description: 5",
        "description: panda\njoints: 3",
        "description: panda\nlocked: [a]",
        "description: panda\npayload: {mass: much}",
        "description: panda\njoint: [a]",
        "- a",
    ],
)
def test_a_damaged_file_is_named(text: str) -> None:
    store("mine", text)
    with pytest.raises(UsageError, match=r"mine\.yaml"):
        find_arm("mine")


@pytest.mark.parametrize("name", ["panda", "two_link", "", "../mine", ".mine", "my arm", "arm.urdf", "a" * 65])
def test_a_name_that_could_be_another_arm_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match="name"):
        check_name(name)


@pytest.mark.parametrize(("home", "expected"), [("", "~/.config"), ("relative", "~/.config"), ("/etc/xdg", "/etc/xdg")])
def test_arms_are_under_the_configuration_of_the_user(
    home: str, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", home)
    assert arms_folder() == Path(expected).expanduser() / "pidtsm/arms"


def test_a_gripper_is_never_locked_silently() -> None:
    arm = ArmDefinition(
        Path("arm.urdf.xacro").read_text("utf-8").replace("$(arg mass)", "2").replace("</robot>", FINGER)
    )
    arguments = '<xacro:arg name="mass"/><xacro:arg name="length" default="0.5"/>'
    arm = replace(arm, description=arm.description.replace("$(arg length)", "0.5").replace(arguments, ""))
    with pytest.warns(GripperLockedWarning, match=r"moves swing, bend; locks grip \(a gripper: by its name"):
        make_experiment(None, robot=arm)
    assert arm.with_joints().joints == ("swing", "bend")


def test_overrides_alone_choose_the_joints() -> None:
    """For an arm whose chain is not known without them."""
    rod = (
        '<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>"
    )
    joint = (
        '<joint name="j{0}" type="revolute"><parent link="base"/><child link="{0}"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="1"/></joint>'
    )
    arm = '<robot name="two"><link name="base"/>' + "".join(rod.format(n) + joint.format(n) for n in "ab") + "</robot>"
    chosen: dict[str, Any] = {node: {"joints": ["jb"]} for node in ("simulator", "controller")}
    experiment = make_experiment(None, robot=arm, overrides=chosen)
    assert experiment.values["trajectory"]["joints"] == ("jb",)
    with pytest.raises(UsageError, match="--joints ja or --joints jb"):
        make_experiment(None, robot=arm)


def test_many_locked_joints_are_counted() -> None:
    found = find_robot({"robot.description": "panda", "joints": ["panda_joint1"]})
    sentence = joints_sentence(found.description)  # type: ignore[attr-defined]
    assert sentence.startswith("moves panda_joint1; locks panda_joint2, panda_joint3")
    assert "\n" not in sentence
