"""Where the tool is, and positions of the joints that bring it somewhere."""

import math
from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Value
from pidtsm_core.robots import Robot, Tool, TreeRobot
from pidtsm_core.robots.tree import forward_kinematics
from pidtsm_core.robots.tree.layout import Column, rows
from pidtsm_core.trajectories.errors import TrajectoryError

_EXACT = 1e-9
"""Largest remaining error, m and rad."""
_ROUNDS = 200
_STARTS = 20
"""Number of starts: the given one and random ones."""
_STEP = 0.5
"""Largest change of a joint in one round, rad or m."""


def tool_pose(robot: Robot, values: Mapping[str, Value], q: Array) -> tuple[Array, Array]:
    """Position (m, shape (3,)) and rotation (shape (3, 3)) of the tool in the base frame.

    Args:
        robot: the arm.
        values: the parameters of its model by full name, see `Robot.pack_model`.
        q: positions of the joints, shape (joints,), rad or m.

    Raises:
        TrajectoryError: it is not known where the tool of this arm is.
    """
    position, rotation, _ = ToolJacobian(robot, values).at(q)
    return position, rotation


def inverse_kinematics(
    robot: Robot,
    values: Mapping[str, Value],
    position: Array,
    rotation: Array | None = None,
    start: Array | None = None,
) -> Array:
    """Positions of the joints within their limits, shape (joints,), rad or m, that bring the tool to a pose.

    Damped least squares (Buss, Introduction to inverse kinematics, 2004, eq. (11)) from `start`, and from random
    positions if that ends elsewhere.

    Args:
        robot: the arm.
        values: the parameters of its model by full name, see `Robot.pack_model`.
        position: of the tool in the base frame, m, shape (3,).
        rotation: of the tool, from its frame to the base frame, shape (3, 3); None: any.
        start: positions of the joints to start from, shape (joints,), rad or m; the result is often close to them;
            None: the default start position of the arm.

    Raises:
        TrajectoryError: it is not known where the tool is, or the arm cannot bring it there; with the distance of the
            closest pose found.
    """
    arm = ToolJacobian(robot, values)
    first = np.array(robot.initial_position if start is None else start, dtype=np.float64)
    random, closest = np.random.default_rng(0), math.inf
    for _ in range(_STARTS):
        q, error = arm.approach(arm.within(first), np.asarray(position, dtype=np.float64), rotation)
        if error < _EXACT:
            return q
        closest = min(closest, error)
        first = arm.lower + random.random(first.size) * (arm.upper - arm.lower)
    of = "" if rotation is None else " in this orientation"
    raise TrajectoryError(
        f"the tool of {robot.name} cannot reach ({', '.join(f'{x:.4g}' for x in position)}) m{of}; "
        f"the closest pose found differs by {closest:.3g} (m and rad)"
    )


class ToolJacobian:
    """Where a tool is, and how it moves with the joints.

    Attributes:
        lower, upper: range of the joints, shape (joints,), rad or m; a turn where there is no limit.
    """

    def __init__(self, robot: Robot, values: Mapping[str, Value]) -> None:
        """Prepare.

        Args:
            robot: the arm.
            values: the parameters of its model by full name, see `Robot.pack_model`.

        Raises:
            TrajectoryError: it is not known where the tool of this arm is.
        """
        tool = None if robot.tool is None else robot.tool(robot.pack_model(values))
        if tool is None or tool.row < 0:
            raise TrajectoryError(f"it is not known where the tool of {robot.name} is")
        self._tool: Tool = tool
        self._axes = robot.description.tool_rotation if isinstance(robot, TreeRobot) else np.eye(3)
        limits = np.array(robot.position_limits or [(-math.inf, math.inf)] * len(robot.joints))
        self._lower, self._upper = limits.T
        middle = np.array(robot.initial_position)
        self.lower, self.upper = np.maximum(self._lower, middle - math.pi), np.minimum(self._upper, middle + math.pi)
        self._placements = np.empty((len(robot.joints), 3, 4))

    def within(self, q: Array) -> Array:
        """The positions within the limits next to q, shape (joints,)."""
        return np.clip(q, self._lower, self._upper)

    def at(self, q: Array) -> tuple[Array, Array, Array]:
        """Position, rotation, and Jacobian of both, shape (6, joints), of the tool; the latter in the base frame."""
        forward_kinematics(q, self._tool.tree, self._placements)
        link = self._placements[self._tool.row]
        position = link[:, :3] @ self._tool.point + link[:, 3]
        jacobian, described, i = np.zeros((6, q.size)), rows(self._tool.tree), self._tool.row
        while i >= 0:
            axis, origin = self._placements[i, :, 2], self._placements[i, :, 3]
            place, slides = int(described[i, Column.PLACE]), described[i, Column.SLIDES] != 0.0
            jacobian[:3, place] = axis if slides else np.cross(axis, position - origin)
            jacobian[3:, place] = 0.0 if slides else axis
            i = int(described[i, Column.PARENT])
        return position, link[:, :3] @ self._axes, jacobian

    def approach(self, q: Array, position: Array, rotation: Array | None) -> tuple[Array, float]:
        """Positions of the joints at the end of damped least squares from q, shape (joints,), and what error remains.

        The pose has a position, shape (3,), m, and a rotation, shape (3, 3), or None for any.
        """
        size = 3 if rotation is None else 6

        def error_at(q: Array) -> tuple[Array, Array]:
            found, axes, jacobian = self.at(q)
            turn = np.zeros(3) if rotation is None else Rotation.from_matrix(rotation @ axes.T).as_rotvec()
            return np.concatenate([position - found, turn])[:size], jacobian[:size]

        error, jacobian = error_at(q)
        damping = 1e-2
        for _ in range(_ROUNDS):
            if (norm := float(np.linalg.norm(error))) < _EXACT:
                break
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + damping * np.eye(size), error)
            step *= min(1.0, _STEP / max(float(np.abs(step).max()), 1e-300))
            other = self.within(q + step)
            error_there, jacobian_there = error_at(other)
            if np.linalg.norm(error_there) < norm:
                q, error, jacobian, damping = other, error_there, jacobian_there, max(1e-12, 0.2 * damping)
            elif damping > 1e3:
                break
            else:
                damping *= 5.0
        return q, float(np.linalg.norm(error))
