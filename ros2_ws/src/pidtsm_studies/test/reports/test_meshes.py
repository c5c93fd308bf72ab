"""The solid arm of the pages: the meshes of a description, in the frames of its joints, with few triangles."""

import base64
import re
from pathlib import Path

import mujoco
import numpy as np
import trimesh

from pidtsm_core.arrays import Array
from pidtsm_core.robots import find_description
from pidtsm_core.robots.placement import joint_placements
from pidtsm_studies.reports.meshes import TRIANGLES, simplified, solids

ARM = """
<robot name="arm">
<link name="base"><visual><origin xyz="0 0 0.1"/><geometry>
<mesh filename="package://arm_description/{base}"/></geometry></visual></link>
<link name="upper"><inertial><mass value="1"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><origin xyz="0.2 0 0" rpy="0 1.5707963267948966 0"/><geometry>
<mesh filename="meshes/upper.obj" scale="0.001 0.001 0.001"/></geometry></visual>
<visual><origin xyz="0.5 0 0"/><geometry><box size="0.1 0.2 0.3"/></geometry></visual></link>
<link name="hand"><visual><geometry><mesh filename="gone.stl"/></geometry></visual></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="upper"/>
<origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>
<axis xyz="0 1 0"/><limit effort="9" velocity="2" lower="-1" upper="1"/></joint>
<joint name="end" type="fixed"><parent link="upper"/><child link="hand"/><origin xyz="0.6 0 0"/></joint>
</robot>
"""


def described(folder: Path, base: str = "meshes/base.stl") -> Path:
    """An arm of a package: its meshes are an STL and an OBJ in millimetres; another is missing."""
    urdf = folder / "arm_description" / "urdf" / "arm.urdf"
    for place in (urdf.parent / "meshes", urdf.parents[1] / "meshes"):
        place.mkdir(parents=True, exist_ok=True)
    trimesh.creation.icosphere(5, 0.1).export(urdf.parents[1] / "meshes" / "base.stl")
    trimesh.creation.box((20.0, 40.0, 400.0)).export(urdf.parent / "meshes" / "upper.obj")
    urdf.write_text(ARM.format(base=base), encoding="utf-8")
    return urdf


def unpacked(text: str) -> Array:
    return np.frombuffer(base64.b64decode(text), "<f4").astype(np.float64).reshape(-1, 3)


def test_meshes_are_where_mujoco_has_the_links_and_few_triangles_remain(tmp_path: Path) -> None:
    urdf = described(tmp_path)
    found = {each["row"]: each for each in solids({"robot.description": str(urdf)})}
    assert sorted(found) == [-1, 0]
    assert sum(unpacked(each["triangles"]).shape[0] for each in found.values()) < 1.3 * TRIANGLES
    base = unpacked(found[-1]["corners"])
    np.testing.assert_allclose(np.linalg.norm(base - [0.0, 0.0, 0.1], axis=1), 0.1, rtol=0.03)
    q = np.array([0.7])
    placement = joint_placements(find_description({"robot.description": str(urdf)}), q)[0]
    corners = unpacked(found[0]["corners"]) @ placement[:, :3].T + placement[:, 3]
    model = mujoco.MjModel.from_xml_string(re.sub(r"<visual>.*?</visual>", "", ARM, flags=re.DOTALL))
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    upper = data.body("upper")
    local = (corners - upper.xpos) @ upper.xmat.reshape(3, 3)
    # The rod is turned to x and in metres; the box is behind its end.
    np.testing.assert_allclose(local.min(axis=0), [0.0, -0.1, -0.15], atol=2e-3)
    np.testing.assert_allclose(local.max(axis=0), [0.55, 0.1, 0.15], atol=2e-3)


def test_an_arm_without_files_of_meshes_has_no_solids(tmp_path: Path) -> None:
    urdf = described(tmp_path, base="meshes/none.stl")
    (urdf.parent / "meshes" / "upper.obj").unlink()
    assert solids({"robot.description": str(urdf)}) == []
    assert solids({"robot.description": "panda"}) == []
    assert solids({"robot.description": "two_link"}) == []
    assert solids({}) == []


def test_a_damaged_mesh_is_left_out(tmp_path: Path) -> None:
    urdf = described(tmp_path)
    (urdf.parents[1] / "meshes" / "base.stl").write_bytes(b"solid nothing" + bytes(200))
    assert [each["row"] for each in solids({"robot.description": str(urdf)})] == [0]


def test_the_shape_is_kept_with_few_triangles(tmp_path: Path) -> None:
    file = tmp_path / "torus.stl"
    torus = trimesh.creation.torus(0.2, 0.05, major_sections=128, minor_sections=64)
    torus.export(file)
    corners, triangles = simplified(str(file), 0, 0, 400)
    assert len(triangles) <= 520
    around = np.hypot(corners[:, 0], corners[:, 1]) - 0.2
    np.testing.assert_allclose(np.hypot(around, corners[:, 2]), 0.05, atol=0.006)
    np.testing.assert_allclose(np.ptp(corners, axis=0), torus.extents, atol=0.01)
