"""Messages of tf for all links of an arm, made without ROS."""

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pidtsm_core.arrays import Array
from pidtsm_core.robots.placement import link_placements, relative_placements
from pidtsm_core.timing import NANOSECONDS
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.export.arm import DrawnArm

TRANSFORMS = "tf2_msgs/msg/TFMessage"
"""Type of the messages."""


class Frames:
    """The frames of the links of an arm, each relative to that of its parent, as robot_state_publisher has them."""

    def __init__(self, arm: DrawnArm, prefix: str, others: Collection[str] = ()) -> None:
        """Choose the frames.

        Args:
            arm: the arm.
            prefix: of the name of every frame; the base of an arm with a prefix is fixed to that of the arm without.
            others: names of frames that somebody else publishes, and which are left out.
        """
        self._arm, self._prefix = arm.description, prefix
        links = self._arm.links
        known = [i for i, name in enumerate(links.names) if prefix + name not in others and (i or prefix)]
        moves = links.rows != links.rows[np.maximum(links.parents, 0)]
        self._moving = [i for i in known if moves[i]]
        self._fixed = [i for i in known if not moves[i]]

    def moving(self, q: Array, stamp: int) -> Any:
        """Message with the frames that joints move.

        Args:
            q: positions in the order of the joints, shape (joints,), rad or m.
            stamp: of the positions, ns.
        """
        return self._message(q, stamp, self._moving)

    def fixed(self) -> Any:
        """Message with the frames that no joint moves, with the stamp 0: they are valid from the beginning."""
        return self._message(np.zeros(len(self._arm.joints)), 0, self._fixed)

    def _message(self, q: Array, stamp: int, chosen: Sequence[int]) -> Any:
        links, types = self._arm.links, typestore().types
        vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
        header, time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
        transform, stamped = types["geometry_msgs/msg/Transform"], types["geometry_msgs/msg/TransformStamped"]
        relative = relative_placements(links, link_placements(self._arm, q))
        turns = Rotation.from_matrix(relative[:, :, :3]).as_quat().tolist()
        frames = []
        for i in chosen:
            # The base of the ghost stands on that of the arm.
            above = self._prefix + links.names[links.parents[i]] if i else links.names[0]
            place = transform(vector(*relative[i, :, 3].tolist()), quaternion(*turns[i]))
            frames.append(
                stamped(header(time(*divmod(stamp, NANOSECONDS)), above), self._prefix + links.names[i], place)
            )
        return types[TRANSFORMS](frames)
