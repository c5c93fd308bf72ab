"""Poses: where a frame is, seen from another one."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from pidtsm_core.arrays import Array
from pidtsm_core.parameters.joints import ABSURD
from pidtsm_core.trajectories.errors import TrajectoryError

_UNIT = 0.1
"""Largest deviation of a quaternion's norm from 1 that counts as rounding."""


class Pose(NamedTuple):
    """A frame, seen from another one.

    Attributes:
        position: of its origin, shape (3,), m.
        rotation: from its axes to those of the other frame, shape (3, 3).
    """

    position: Array
    rotation: Array

    def __matmul__(self, other: "Pose") -> "Pose":
        """A pose seen from this frame, seen from where this frame is seen from."""
        return Pose(self.position + self.rotation @ other.position, self.rotation @ other.rotation)

    @property
    def inverse(self) -> "Pose":
        """The other frame, seen from this one."""
        return Pose(-self.rotation.T @ self.position, self.rotation.T)

    def quaternion(self) -> Array:
        """Unit quaternion x, y, z, w, shape (4,)."""
        return np.asarray(Rotation.from_matrix(self.rotation).as_quat())

    def way_to(self, other: "Pose") -> tuple[Array, Array]:
        """Displacement (m) and rotation vector (rad) to another pose, in the axes of the other frame, shape (3,)."""
        turn = Rotation.from_matrix(other.rotation @ self.rotation.T).as_rotvec()
        return other.position - self.position, np.asarray(turn)

    def moved(self, displacement: Array, turn: Array) -> "Pose":
        """The pose after a displacement (m) and a rotation vector (rad), see `way_to`."""
        return Pose(self.position + displacement, Rotation.from_rotvec(turn).as_matrix() @ self.rotation)


NOWHERE_ELSE = Pose(np.zeros(3), np.eye(3))
"""A frame that is the other one."""


def read_pose(position: Sequence[float] | Array, quaternion: Sequence[float] | Array) -> Pose:
    """A pose from numbers that someone has sent.

    Args:
        position: x, y, z, shape (3,), m.
        quaternion: x, y, z, w, shape (4,); its norm may differ from 1 by a tenth.

    Raises:
        TrajectoryError: a number is not finite or absurdly large, or the quaternion is zero or not of norm 1.
    """
    return Pose(read_vector("position", position), read_rotation(quaternion))


def read_vector(what: str, values: Sequence[float] | Array) -> Array:
    """A vector of three numbers, shape (3,).

    Raises:
        TrajectoryError: there are not three, or one is not finite or absurdly large; the message begins with `what`.
    """
    vector = np.array(values, dtype=np.float64)
    if vector.shape != (3,):
        raise TrajectoryError(f"{what} has {vector.size} numbers; x y z are expected")
    if not (np.abs(vector) < ABSURD).all():
        raise TrajectoryError(f"{what} ({', '.join(f'{x:g}' for x in vector)}) is not finite, or absurd")
    return vector


def read_rotation(quaternion: Sequence[float] | Array) -> Array:
    """The rotation matrix of a quaternion x, y, z, w, shape (3, 3).

    Raises:
        TrajectoryError: see `read_pose`.
    """
    numbers = np.array(quaternion, dtype=np.float64)
    if numbers.shape != (4,):
        raise TrajectoryError(f"orientation has {numbers.size} numbers; a quaternion x y z w is expected")
    text = f"orientation ({', '.join(f'{x:g}' for x in numbers)})"
    norm = float(np.linalg.norm(numbers)) if np.isfinite(numbers).all() else math.nan
    if math.isnan(norm):
        raise TrajectoryError(f"{text} is not finite")
    if norm == 0.0:
        raise TrajectoryError(
            "orientation is the zero quaternion, which is no rotation; 0 0 0 1 is none of the axes turned"
        )
    if abs(norm - 1.0) > _UNIT:
        raise TrajectoryError(f"{text} has the norm {norm:.3g}; a quaternion x y z w of norm 1 is expected")
    return np.asarray(Rotation.from_quat(numbers).as_matrix())
