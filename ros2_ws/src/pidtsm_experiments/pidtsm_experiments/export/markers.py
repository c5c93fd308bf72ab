"""Markers that draw an arm as lines from link to link, made without ROS; viewers need neither meshes nor tf."""

from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots.picture import ARM_COLOR, BONE_WIDTH, GHOST_COLOR, bones, reach
from pidtsm_core.robots.placement import link_placements
from pidtsm_core.timing import NANOSECONDS
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.export.arm import GHOST, DrawnArm

MARKERS = "visualization_msgs/msg/MarkerArray"
"""Type of the messages."""


class Skeleton:
    """An arm as lines."""

    def __init__(self, arm: DrawnArm, ghost: bool) -> None:
        """Choose the arm; `ghost`: whether it shows the reference."""
        self._arm, self._ghost = arm.description, ghost
        self._width = BONE_WIDTH * reach(self._arm)

    def markers(self, q: Array, stamp: int) -> Any:
        """Message with the arm.

        Args:
            q: positions in the order of the joints, shape (joints,), rad or m.
            stamp: of the positions, ns.
        """
        links, types = self._arm.links, typestore().types
        point, time = types["geometry_msgs/msg/Point"], types["builtin_interfaces/msg/Time"]
        vector, pose = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Pose"]
        marker: Any = types["visualization_msgs/msg/Marker"]
        color = types["std_msgs/msg/ColorRGBA"]
        nowhere = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        ends = [point(*each) for each in bones(links, link_placements(self._arm, q)).tolist()]
        lines = marker(
            header=types["std_msgs/msg/Header"](time(*divmod(stamp, NANOSECONDS)), links.names[0]),
            ns=GHOST if self._ghost else "arm",
            id=0,
            type=marker.LINE_LIST,
            action=marker.ADD,
            pose=pose(point(0.0, 0.0, 0.0), nowhere),
            scale=vector(self._width, 0.0, 0.0),
            color=color(*(GHOST_COLOR if self._ghost else ARM_COLOR)),
            lifetime=types["builtin_interfaces/msg/Duration"](0, 0),
            frame_locked=False,
            points=ends,
            colors=[],
            texture_resource="",
            texture=types["sensor_msgs/msg/CompressedImage"](
                types["std_msgs/msg/Header"](time(0, 0), ""), "", np.zeros(0, dtype=np.uint8)
            ),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=types["visualization_msgs/msg/MeshFile"]("", np.zeros(0, dtype=np.uint8)),
            mesh_use_embedded_materials=False,
        )
        return types[MARKERS]([lines])
