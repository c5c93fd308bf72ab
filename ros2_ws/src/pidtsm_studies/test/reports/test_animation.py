"""The animated arm is where MuJoCo has it, and is first seen from where its motion is visible."""

import base64
import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.recording import Recording
from pidtsm_core.robots import find_robot
from pidtsm_core.robots.source import ARMS, read_source
from pidtsm_core.signals import Signal, Status
from pidtsm_studies.reports import skeleton
from pidtsm_studies.reports.animation import animation, moments

"""Link with the tool, where it is not ``tool``."""
SAMPLES = 40
RATE = 50.0  # of the animation, 1/s
LINK = (
    '<link name="{0}"><inertial><origin xyz="0.1 0 0.1"/><mass value="1"/>'
    '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="{4}"/><axis xyz="{5}"/>'
    '<limit effort="9" velocity="2" lower="-1" upper="1"/></joint>'
)


def two_links(axis: str, along: str, kind: str = "revolute") -> str:
    """A planar arm whose joints turn about an axis, and whose links have a direction; or slide."""
    joints = JOINT.format("a", kind, "base", "one", "0 0 0", axis) + JOINT.format("b", kind, "one", "two", along, axis)
    end = f'<joint name="c" type="fixed"><parent link="two"/><child link="end"/><origin xyz="{along}"/></joint>'
    links = f'<link name="base"/>{LINK.format("one")}{LINK.format("two")}<link name="end"/>'
    return f'<robot name="planar">{links}{joints}{end}</robot>'


def recorded(description: str, backwards: bool = False) -> Recording:
    """A random motion; the joints of the recording may have the opposite order."""
    robot = find_robot({"robot.description": description})
    random, joints = np.random.default_rng(0), len(robot.joints)
    stamps = np.arange(SAMPLES) * round(1e9 / RATE)
    return Recording(
        joints=robot.joints[::-1] if backwards else robot.joints,
        time=stamps / 1e9,
        stamps_ns=stamps,
        position=random.uniform(-2.0, 2.0, (SAMPLES, joints)),
        velocity=np.zeros((SAMPLES, joints)),
        effort=np.zeros((SAMPLES, joints)),
        reference=random.uniform(-2.0, 2.0, (SAMPLES, 3, joints)),
        signals=np.zeros((SAMPLES, len(Signal), joints)),
        status=np.zeros((SAMPLES, len(Status)), dtype=np.uint8),
        compute_time=np.empty(0),
        scenario=None,
        law=None,
        clock=None,
        event_time=None,
        slides=robot.slides[::-1] if backwards else robot.slides,
        robot={"robot.description": description, "joints": list(robot.joints)},
    )


def animated(recording: Recording) -> tuple[dict[str, Any], dict[str, Any]]:
    """All data, and those of the only run."""
    data = animation({"case": {"law": (recording, {})}})
    return data, data["runs"]["case law"]


def unpacked(packed: str, *shape: int) -> Array:
    return np.frombuffer(base64.b64decode(packed), "<f4").astype(np.float64).reshape(*shape)


def judged(name: str, joints: tuple[str, ...], q: Array) -> tuple[Array, Array, Array]:
    """The joint axes' anchors and directions, shape (joints, 3), and the tool, by MuJoCo."""
    text = read_source(name)[1]
    text = text[: text.rindex("</robot>")] + '<mujoco><compiler fusestatic="false"/></mujoco></robot>'
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    ids = [model.joint(joint).id for joint in joints]
    data.qpos[ids] = q
    mujoco.mj_kinematics(model, data)
    return data.xanchor[ids], data.xaxis[ids], data.body("tool").xpos


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("name", ARMS)
def test_arm_reference_and_tool_are_where_mujoco_has_them(name: str, backwards: bool) -> None:
    recording = recorded(name, backwards)
    data, run = animated(recording)
    robot = find_robot({"robot.description": name})
    points = len(robot.joints) + 1
    order = slice(None, None, -1) if backwards else slice(None)
    turning = [j for j, slides in enumerate(robot.slides) if not slides]
    assert run["sliding"] == [j for j, slides in enumerate(robot.slides) if slides]
    assert run["parents"] == [-1, *range(points - 1)]
    assert [recording.joints[place] for place in run["places"]] == list(robot.joints)
    for part, positions in (("reached", recording.position), ("reference", recording.reference[:, 0])):
        found = unpacked(run[part], SAMPLES, points, 3)
        for k in range(0, SAMPLES, 13):
            anchors, axes, tool = judged(name, robot.joints, positions[k, order])
            np.testing.assert_allclose(found[k, :-1][turning], anchors[turning], atol=1e-6)
            np.testing.assert_allclose(found[k, -1], tool, atol=1e-6)
            if part == "reached":
                turns = Rotation.from_quat(unpacked(run["turns"], SAMPLES, points - 1, 4)[k])
                np.testing.assert_allclose(turns.as_matrix()[:, :, 2], axes, atol=1e-6)
        assert np.linalg.norm(found - data["centre"], axis=2).max() <= data["radius"] + 1e-3
    apart = unpacked(run["reached"], SAMPLES, points, 3)[:, -1] - unpacked(run["reference"], SAMPLES, points, 3)[:, -1]
    np.testing.assert_allclose(unpacked(run["distance"], SAMPLES), np.linalg.norm(apart, axis=1), atol=1e-5)
    np.testing.assert_allclose(unpacked(moments(recording)["error"], SAMPLES, points - 1), recording.error, atol=1e-6)


def test_the_two_link_arm_has_the_recorded_lengths() -> None:
    recording = recorded("two_link")
    recording.robot.update({"joints": list(recording.joints), "robot.r1": 0.7, "robot.r2": 0.4})  # type: ignore[attr-defined]
    _, run = animated(recording)
    one, both = recording.position[:, 0], recording.position.sum(axis=1)
    elbow = np.column_stack([0.7 * np.cos(one), 0.0 * one, 0.7 * np.sin(one)])
    tool = elbow + np.column_stack([0.4 * np.cos(both), 0.0 * one, 0.4 * np.sin(both)])
    expected = np.stack([0.0 * elbow, elbow, tool], axis=1)
    np.testing.assert_allclose(unpacked(run["reached"], SAMPLES, 3, 3), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("description", "view"),
    [
        ("two_link", (-90, 0)),
        (two_links("0 1 0", "0.3 0 0"), (-90, 0)),
        (two_links("1 0 0", "0 0 0.3"), (0, 0)),
        (two_links("0 0 1", "0 0.3 0"), (-90, 90)),
        (two_links("0 1 1", "0.3 0 0"), (90, 45)),
        (two_links("0 0 1", "0 0 0.3", "prismatic"), (-60, 20)),  # on a line
        ("panda", (-60, 20)),
        ("scara", (-60, 20)),
    ],
)
def test_a_planar_arm_is_first_seen_on_its_plane(description: str, view: tuple[float, float]) -> None:
    data, _ = animated(recorded(description))
    np.testing.assert_allclose(np.degrees(data["view"]), view, atol=1e-3)


def test_the_grid_is_a_round_fraction_of_the_arm() -> None:
    for name in ("two_link", *ARMS):
        data, _ = animated(recorded(name))
        assert 0.19 * data["radius"] < data["grid"] <= 0.5 * data["radius"]
        assert round(data["grid"] / 10 ** math.floor(math.log10(data["grid"])), 9) in (1, 2, 5)


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({}, "the recording does not contain the parameters of the arm"),
        ({"robot.description": "/gone/arm.urdf"}, "robot.description: /gone/arm.urdf: No such file or directory"),
        ({"robot.description": "panda", "joints": ["left"]}, "there is no movable joint left"),
        ({"robot.description": "two_link", "robot.r1": "long"}, "robot.r1"),
        ({"robot.description": "ur5"}, "the recorded joints are not those of ur5"),
    ],
)
def test_an_unknown_arm_is_explained_in_one_line(parameters: dict[str, object], reason: str) -> None:
    recording = recorded("panda")
    object.__setattr__(recording, "robot", parameters)
    with pytest.raises(ParameterError, match=reason) as raised:
        animated(recording)
    assert "\n" not in str(raised.value)


def test_a_closed_form_without_kinematics_is_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(skeleton, "TWO_LINK", None)
    with pytest.raises(ParameterError, match="two_link is a closed form"):
        animated(recorded("two_link"))


def test_a_description_in_a_file_is_drawn(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(two_links("0 1 0", "0.3 0 0"), encoding="utf-8")
    assert animated(recorded(str(file)))[1]["places"] == [0, 1]
