"""Frames from a URDF match the closed form; unsupported URDFs are rejected with the reason."""

import math

import numpy as np
import pytest

from two_link_sim.kinematics import UrdfError, link_poses, read_urdf
from two_link_sim.visualization_node import _two_link

LINK = "<link name='a'/><link name='b'/>"


@pytest.mark.parametrize(("q1", "q2"), [(0.0, 0.0), (0.3, -0.8), (-2.0, 1.5)])
def test_link_ends_match_the_closed_form(q1: float, q2: float) -> None:
    poses = link_poses(read_urdf(_two_link()), {"joint1": q1, "joint2": q2})
    elbow = np.array([math.cos(q1), 0.0, math.sin(q1)])
    hand = elbow + 0.85 * np.array([math.cos(q1 + q2), 0.0, math.sin(q1 + q2)])
    np.testing.assert_allclose(poses["link2"][:3, 3], elbow, atol=1e-12)
    np.testing.assert_allclose((poses["link2"] @ [0.85, 0.0, 0.0, 1.0])[:3], hand, atol=1e-12)


def test_joints_are_listed_after_their_parents_and_fixed_joints_do_not_move() -> None:
    text = """<robot name="r"><link name="base"/><link name="arm"/><link name="tool"/>
      <joint name="flange" type="fixed"><parent link="arm"/><child link="tool"/>
        <origin xyz="0 0 0.5" rpy="0 0 1.5707963267948966"/></joint>
      <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 2"/></joint>
    </robot>"""
    joints = read_urdf(text)
    assert [j.name for j in joints] == ["turn", "flange"]
    assert [j.turns for j in joints] == [True, False]
    tool = link_poses(joints, {"turn": math.pi / 2, "flange": 1.0})["tool"]
    np.testing.assert_allclose(tool @ [1.0, 0.0, 0.0, 1.0], [-1.0, 0.0, 0.5, 1.0], atol=1e-12)


@pytest.mark.parametrize(
    ("joints", "reason"),
    [
        ("<joint", "not XML"),
        ("", "one root link"),
        ("<joint name='j' type='prismatic'><parent link='a'/><child link='b'/></joint>", "joint j is prismatic"),
        ("<joint name='j' type='fixed'><parent link='a'/><child/></joint><joint name='k' type='fixed'/>", "lacks"),
        (
            "<joint name='j' type='fixed'><parent link='a'/><child link='b'/><origin xyz='0 x 0'/></joint>",
            "origin xyz must be three numbers",
        ),
        (
            "<joint name='j' type='fixed'><parent link='a'/><child link='b'/></joint>"
            "<joint name='k' type='fixed'><parent link='c'/><child link='d'/></joint>",
            "one root link",
        ),
    ],
)
def test_unsupported_urdfs_are_rejected(joints: str, reason: str) -> None:
    with pytest.raises(UrdfError, match=reason):
        read_urdf(f"<robot name='r'>{LINK}{joints}</robot>")
