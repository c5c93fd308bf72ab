"""The wrench on the tool that explains what acts on the joints from outside."""

from collections.abc import Mapping

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Value
from pidtsm_core.robots import Robot
from pidtsm_core.trajectories.tool import ToolJacobian

_LENGTH = 0.3
"""1 N m counts as much as the force with this lever, m."""
_SINGULAR = 0.02
"""Directions of the tool with smaller singular values (m, and `_LENGTH` rad, per rad) show little of the wrench."""


class ToolWrench:
    """Turns efforts of the joints into a wrench on the tool: J' w = effort, by damped least squares.

    An arm with fewer than six joints, or near a singularity, does not feel every direction; there the wrench is too
    small, but not too large.
    """

    def __init__(self, robot: Robot, values: Mapping[str, Value]) -> None:
        """Prepare.

        Args:
            robot: the arm.
            values: the parameters of its model by full name, see `Robot.pack_model`.

        Raises:
            TrajectoryError: it is not known where the tool of this arm is.
        """
        self._tool = ToolJacobian(robot, values)
        self._weights = np.repeat([1.0, _LENGTH], 3)

    def of(self, q: Array, effort: Array) -> Array:
        """Force (N) and torque (N m) on the origin of the tool, in the axes of the tool, shape (6,).

        Args:
            q: positions of the joints, shape (joints,), rad or m.
            effort: that acts on the joints from outside, shape (joints,), N m or N.
        """
        _, rotation, jacobian = self._tool.at(q)
        u, values, vt = np.linalg.svd(self._weights[:, None] * jacobian, full_matrices=False)
        inverse = values / (values * values + np.maximum(_SINGULAR - values, 0.0) ** 2)
        wrench = self._weights * (u @ (inverse * (vt @ effort)))
        return np.concatenate([rotation.T @ wrench[:3], rotation.T @ wrench[3:]])
