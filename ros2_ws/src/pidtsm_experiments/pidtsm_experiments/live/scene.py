"""The arm in 3-D: its links, the reference as a ghost, and an arc or arrow for each effort."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from viser import FrameHandle, SceneApi

from pidtsm_core.arrays import Array
from pidtsm_core.robots import Description
from pidtsm_core.robots.picture import effort_arc, effort_arrow, effort_color, effort_shares, reach
from pidtsm_core.robots.placement import joint_placements
from pidtsm_core.robots.tree.layout import Column, rows
from pidtsm_studies.reports.meshes import Solid

# Lengths as shares of the reach of the arm.
_BONE_RADIUS = 0.018
_HUB_RADIUS, _HUB_LENGTH = 0.03, 0.08
_EFFORT_WIDTH = 0.012
_SHORTEST_BONE = 1e-3

_BONE, _HUB, _GHOST, _SOLID = (70, 105, 150), (238, 145, 40), (120, 120, 120), (228, 232, 238)
_GHOST_OPACITY = 0.3
_CAMERA = np.array([0.4, -1.6, 0.5])
"""Place of the camera from the middle of the arm, in reaches."""
_POINTS = 23
"""Line segments of an arc; an arrow is one of them, repeated."""


class ArmScene:
    """The arm and its ghost: one frame for the base and one for each joint, with meshes that do not change."""

    def __init__(self, scene: SceneApi, arm: Description, solids: Sequence[Solid] = ()) -> None:
        """Add everything to the scene; the arm stands at zero until `show`.

        Args:
            scene: of the page.
            arm: the arm.
            solids: its meshes; without them it has rods from link to link.
        """
        self._scene, self._arm, self._size = scene, arm, reach(arm)
        scene.set_up_direction("+z")
        size = self._size
        scene.add_grid("/grid", 4.0 * size, 4.0 * size, cell_size=size / 5.0, section_size=size, plane_opacity=0.0)
        placements = joint_placements(arm, np.zeros(len(arm.joints)))
        self._frames: dict[str, list[FrameHandle]] = {}
        for name, ghost in (("arm", False), ("reference", True)):
            scene.add_frame(f"/{name}", show_axes=False)
            self._frames[name] = [scene.add_frame(f"/{name}/{j}", show_axes=False) for j in range(len(arm.joints))]
            looks: dict[str, Any] = {"opacity": _GHOST_OPACITY, "cast_shadow": False} if ghost else {}
            for solid in solids:
                place = int(rows(arm.tree)[solid.row, Column.PLACE]) if solid.row >= 0 else "base"
                color = _GHOST if ghost else _SOLID
                mesh = np.asarray(solid.corners, dtype=np.float32), np.asarray(solid.triangles, dtype=np.uint32)
                scene.add_mesh_simple(
                    f"/{name}/{place}/solid", *mesh, color=color, flat_shading=True, side="double", **looks
                )
            if solids:
                continue
            for joint in range(len(arm.joints)):
                color = _GHOST if ghost else _HUB
                scene.add_cylinder(f"/{name}/{joint}/hub", _HUB_RADIUS * size, _HUB_LENGTH * size, color, **looks)
            for i, bone in enumerate(_bones(arm, placements, size)):
                place = f"/{name}/{bone.joint}" if bone.joint >= 0 else f"/{name}/base"
                _add_bone(scene, f"{place}/{i}", bone, size, _GHOST if ghost else _BONE, looks)
        empty = np.zeros((len(arm.joints) * _POINTS, 2, 3), dtype=np.float32)
        self._efforts = scene.add_line_segments("/efforts", empty, empty, thickness=_EFFORT_WIDTH * size)

    @property
    def camera(self) -> tuple[Array, Array]:
        """Where a camera sees the whole arm: its place, and the point that it looks at, each of shape (3,), m."""
        middle = joint_placements(self._arm, np.zeros(len(self._arm.joints)))[:, :, 3].mean(axis=0)
        return middle + _CAMERA * self._size, middle

    def show(self, position: Array, reference: Array | None, efforts: Array) -> None:
        """Move arm and ghost; all in the order of the description's joints.

        Args:
            position: q, shape (joints,), rad or m.
            reference: q_d, likewise; None: there is none, and the ghost is hidden.
            efforts: shape (joints,), N m or N; nan: not shown.
        """
        placements = joint_placements(self._arm, position)
        self._move("arm", placements)
        if reference is not None:
            self._move("reference", joint_placements(self._arm, reference))
        for frame in self._frames["reference"]:
            if frame.visible != (reference is not None):
                frame.visible = reference is not None
        self._show_efforts(placements, efforts)

    def _move(self, name: str, placements: Array) -> None:
        turns = Rotation.from_matrix(placements[:, :, :3]).as_quat(scalar_first=True)
        for frame, turn, placement in zip(self._frames[name], turns, placements, strict=True):
            frame.wxyz, frame.position = turn, placement[:, 3]

    def _show_efforts(self, placements: Array, efforts: Array) -> None:
        shares = effort_shares(self._arm, efforts)
        points = np.zeros((len(shares), _POINTS, 2, 3), dtype=np.float32)
        colors = np.zeros((len(shares), _POINTS, 2, 3), dtype=np.uint8)
        for joint in np.flatnonzero(np.isfinite(shares)):
            line = effort_arrow if self._arm.slides[joint] else effort_arc
            drawn = line(placements[joint], float(shares[joint]), self._size)
            points[joint] = np.stack([drawn[:-1], drawn[1:]], axis=1)
            colors[joint] = np.multiply(255, effort_color(float(shares[joint]))).astype(np.uint8)
        self._efforts.points = points.reshape(-1, 2, 3)
        self._efforts.colors = colors.reshape(-1, 2, 3)


class _Bone(NamedTuple):
    """A line from one link to the next."""

    joint: int  # that it moves with; -1: it does not move
    ends: Array  # in the frame of the joint, shape (2, 3), m


def _bones(arm: Description, placements: Array, size: float) -> Iterator[_Bone]:
    """The lines between the links; a link that slides takes its line along.

    Args:
        arm: the arm.
        placements: of the joints, see `joint_placements`.
        size: reach of the arm, m; much shorter lines are left out.
    """
    links, place = arm.links, rows(arm.tree)[:, Column.PLACE].astype(int)
    frames = np.concatenate([placements, np.eye(3, 4)[np.newaxis]])  # The base comes last, where -1 finds it.
    carriers = np.append(place, -1)[links.rows]
    origins = np.einsum("lij,lj->li", frames[carriers][:, :, :3], links.placements[:, :, 3]) + frames[carriers][:, :, 3]
    for link, parent in enumerate(links.parents[1:], start=1):
        above, below = carriers[parent], carriers[link]
        joint = int(below if below != above and below >= 0 and arm.slides[below] else above)
        ends = (origins[[parent, link]] - frames[joint][:, 3]) @ frames[joint][:, :3]
        if np.linalg.norm(ends[1] - ends[0]) > _SHORTEST_BONE * size:
            yield _Bone(joint, ends)


def _add_bone(scene: SceneApi, name: str, bone: _Bone, size: float, color: Any, looks: Mapping[str, Any]) -> None:
    """A rod with a ball at its end."""
    along = bone.ends[1] - bone.ends[0]
    length, radius = float(np.linalg.norm(along)), _BONE_RADIUS * size
    turn = Rotation.align_vectors(along[np.newaxis], [[0.0, 0.0, 1.0]])[0].as_quat(scalar_first=True)
    middle = bone.ends.mean(axis=0)
    scene.add_cylinder(f"{name}/rod", radius, length, color, wxyz=turn, position=middle, **looks)
    scene.add_icosphere(f"{name}/ball", radius, color, position=bone.ends[1], **looks)
