"""The solid arm of the pages: the meshes of a description, in the frames of its joints, with few triangles."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import mujoco
import numpy as np
import trimesh

from pidtsm_core.robots import find_description
from pidtsm_core.robots.placement import joint_placements
from pidtsm_studies.reports.meshes import TRIANGLES, simplified, solids

Described: TypeAlias = Callable[..., Path]


def test_meshes_are_where_mujoco_has_the_links_and_few_triangles_remain(described: Described, tmp_path: Path) -> None:
    urdf = described(tmp_path)
    found = {each.row: each for each in solids({"robot.description": str(urdf)})}
    assert sorted(found) == [-1, 0]
    assert sum(len(each.triangles) for each in found.values()) < 1.3 * TRIANGLES
    base = found[-1].corners
    np.testing.assert_allclose(np.linalg.norm(base - [0.0, 0.0, 0.1], axis=1), 0.1, rtol=0.03)
    q = np.array([0.7])
    placement = joint_placements(find_description({"robot.description": str(urdf)}), q)[0]
    corners = found[0].corners @ placement[:, :3].T + placement[:, 3]
    model = mujoco.MjModel.from_xml_string(
        re.sub(r"<visual>.*?</visual>", "", urdf.read_text(encoding="utf-8"), flags=re.DOTALL)
    )
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    upper = data.body("upper")
    local = (corners - upper.xpos) @ upper.xmat.reshape(3, 3)
    # The rod is turned to x and in metres; the box is behind its end.
    np.testing.assert_allclose(local.min(axis=0), [0.0, -0.1, -0.15], atol=2e-3)
    np.testing.assert_allclose(local.max(axis=0), [0.55, 0.1, 0.15], atol=2e-3)


def test_an_arm_without_files_of_meshes_has_no_solids(described: Described, tmp_path: Path) -> None:
    urdf = described(tmp_path, base="meshes/none.stl")
    (urdf.parent / "meshes" / "upper.obj").unlink()
    assert solids({"robot.description": str(urdf)}) == []
    assert solids({"robot.description": "panda"}) == []
    assert solids({"robot.description": "two_link"}) == []
    assert solids({}) == []


def test_a_damaged_mesh_is_left_out(described: Described, tmp_path: Path) -> None:
    urdf = described(tmp_path)
    (urdf.parents[1] / "meshes" / "base.stl").write_bytes(b"solid nothing" + bytes(200))
    assert [each.row for each in solids({"robot.description": str(urdf)})] == [0]


def test_the_shape_is_kept_with_few_triangles(tmp_path: Path) -> None:
    file = tmp_path / "torus.stl"
    torus = trimesh.creation.torus(0.2, 0.05, major_sections=128, minor_sections=64)
    torus.export(file)
    corners, triangles = simplified(str(file), 0, 0, 400)
    assert len(triangles) <= 520
    around = np.hypot(corners[:, 0], corners[:, 1]) - 0.2
    np.testing.assert_allclose(np.hypot(around, corners[:, 2]), 0.05, atol=0.006)
    np.testing.assert_allclose(np.ptp(corners, axis=0), torus.extents, atol=0.01)


MJCF = """
<mujoco><asset><mesh name="wedge" vertex="0 0 0  0.3 0 0  0 0.2 0  0 0 0.1"/></asset><worldbody>
<body name="base" pos="0 0 0.2"><body name="arm" pos="0.1 0 0" euler="0 30 0">
<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/><joint name="turn" axis="0 1 0" range="-1 1"/>
<geom type="box" size="1 1 1"/><geom type="mesh" mesh="wedge" pos="0.05 0 0" contype="0" conaffinity="0"/>
</body></body></worldbody><actuator><motor joint="turn" forcerange="-9 9"/></actuator></mujoco>
"""


def test_meshes_of_an_mjcf_are_where_mujoco_has_them() -> None:
    (solid,) = solids({"robot.description": MJCF})
    q = np.array([0.4])
    placement = joint_placements(find_description({"robot.description": MJCF}), q)[0]
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    wedge = np.array([[0.05, 0.0, 0.0], [0.35, 0.0, 0.0], [0.05, 0.2, 0.0], [0.05, 0.0, 0.1]])
    body = data.body("arm")
    expected = wedge @ body.xmat.reshape(3, 3).T + body.xpos
    found = solid.corners @ placement[:, :3].T + placement[:, 3]
    assert found.shape == (4, 3)
    for corner in expected:
        assert np.linalg.norm(found - corner, axis=1).min() < 0.005
