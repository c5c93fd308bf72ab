"""Joints and links are where MuJoCo has them, also those that the tree does not keep."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from pidtsm_core import robots
from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.robots import ROBOTS, find_description, find_robot
from pidtsm_core.robots.description import Description, read_description
from pidtsm_core.robots.placement import joint_placements, link_placements
from pidtsm_core.robots.source import ARMS, read_source

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
LIMIT = '<limit lower="-1" upper="1" effort="9" velocity="9"/>'


def link(name: str) -> str:
    return f'<link name="{name}">{INERTIAL}</link>'


def joint(name: str, kind: str, parent: str, child: str, axis: str) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 -0.2 0.4" rpy="0.3 -0.8 1.1"/><axis xyz="{axis}"/>{LIMIT}</joint>'
    )


BRANCHED = "".join(
    (
        '<robot name="branched"><link name="floor"/>',
        *(link(name) for name in ("stand", "mast", "boom", "hook", "finger", "camera")),
        joint("screws", "fixed", "floor", "stand", "1 0 0"),
        joint("slew", "continuous", "stand", "mast", "1 2 -1"),
        joint("lift", "prismatic", "mast", "boom", "0 1 1"),
        joint("tilt", "revolute", "boom", "hook", "-1 0 0"),
        joint("grip", "prismatic", "hook", "finger", "0 1 0"),
        joint("mount", "fixed", "mast", "camera", "1 0 0"),
        "</robot>",
    )
)
MJCF = """<mujoco><worldbody><body name="stand" pos="0.1 0.2 0.3" euler="10 20 30"><geom size="0.1"/>
    <body pos="0 0 0.4"><joint name="turn" axis="1 0 1" pos="0.1 0 0.05"/><geom size="0.1"/>
        <body name="tip" pos="0.3 0 0" quat="0.6 0 0.8 0">
            <joint name="reach" type="slide" axis="0 1 0"/><geom size="0.1"/>
    </body></body></body></worldbody></mujoco>"""
TEXTS = {name: read_source(name)[1] for name in ARMS} | {"branched": BRANCHED, "mjcf": MJCF}


def judge(text: str, positions: Mapping[str, float]) -> tuple[Any, Any]:
    """MuJoCo's model with all links of a URDF, and its data at these positions."""
    kept = text.replace("</robot>", '<mujoco><compiler fusestatic="false"/></mujoco></robot>')
    model = mujoco.MjModel.from_xml_string(kept)
    data = mujoco.MjData(model)
    for name, position in positions.items():
        data.qpos[model.joint(name).qposadr[0]] = position
    mujoco.mj_kinematics(model, data)
    return model, data


def placed(rotation: Array, translation: Array) -> Array:
    return np.column_stack([rotation.reshape(3, 3), translation])


def read(name: str) -> Description:
    """The arm, its joints from the last to the first, a joint of `BRANCHED` locked."""
    text = TEXTS[name]
    joints, locked = read_description(text, None).joints, {}
    if name == "branched":
        joints, locked = ("slew", "lift", "tilt"), {"grip": 0.25}
    return read_description(text, joints[::-1], locked)


@pytest.mark.parametrize("name", TEXTS)
def test_placements_are_those_of_mujoco(name: str) -> None:
    arm, random = read(name), np.random.default_rng(0)
    for _ in range(5):
        q = random.uniform(-3.0, 3.0, len(arm.joints))
        model, data = judge(TEXTS[name], {**arm.locked, **dict(zip(arm.joints, q, strict=True))})
        for link, placement in zip(arm.links.names, link_placements(arm, q), strict=True):
            body = model.body(link).id if link != "body2" else 2
            np.testing.assert_allclose(placement, placed(data.xmat[body], data.xpos[body]), atol=1e-12)
        for moved, placement in zip(arm.joints, joint_placements(arm, q), strict=True):
            row = model.joint(moved).id
            np.testing.assert_allclose(placement[:, 2], data.xaxis[row], atol=1e-12)
            if model.jnt_type[row] == mujoco.mjtJoint.mjJNT_HINGE:
                np.testing.assert_allclose(placement[:, 3], data.xanchor[row], atol=1e-12)


def test_links_are_those_of_the_description() -> None:
    links = read("branched").links
    assert (links.names[0], links.parents[0]) == ("floor", -1)
    assert dict(zip(links.names[1:], (links.names[parent] for parent in links.parents[1:]), strict=True)) == {
        "stand": "floor",
        "mast": "stand",
        "boom": "mast",
        "hook": "boom",
        "finger": "hook",
        "camera": "mast",
    }
    assert read("mjcf").links.names == ("world", "stand", "body2", "tip")
    assert read("panda").links.names[:2] == ("world", "panda_link0")


@pytest.mark.parametrize("name", [*ROBOTS.names, *ARMS])
def test_every_robot_has_a_description_with_its_joints(name: str) -> None:
    settings = {"robot.description": name}
    found = find_description(settings)
    assert found.joints == find_robot(settings).joints
    assert found.links.names[-1] == "tool"
    assert found.urdf.lstrip().startswith("<?xml")


def test_viewers_get_no_text_of_an_mjcf() -> None:
    assert find_description({"robot.description": MJCF}).urdf == ""
    assert find_description({"robot.description": BRANCHED}).urdf == BRANCHED


def test_a_closed_form_without_a_urdf_cannot_be_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    with pytest.raises(ParameterError, match=r"robot\.description: .* package two_link_sim is not among the installed"):
        find_description({})
    monkeypatch.setattr(robots, "find_robot", lambda _: replace(ROBOTS["two_link"], urdf=""))
    with pytest.raises(ParameterError, match=r"robot\.description: two_link is a closed form without a URDF"):
        find_description({})
