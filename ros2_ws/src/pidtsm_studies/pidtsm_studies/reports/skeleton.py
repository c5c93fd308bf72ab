"""The skeleton of an arm: where the origins of its joints and its tool are."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError, as_float, names, resolve
from pidtsm_core.robots import Description, TreeRobot, find_robot, robot_schema
from pidtsm_core.robots.tree.kinematics import forward_kinematics
from pidtsm_core.robots.tree.layout import Column, rotation, rows, size
from pidtsm_core.robots.two_link import TWO_LINK

_LIFTED = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Frame of a joint that lifts a link from x towards z."""


@dataclass(frozen=True)
class Skeleton:
    """The kinematics of an arm.

    Attributes:
        joints: names, in the order of positions.
        tree: see `pidtsm_core.robots.tree.layout`; only its geometry counts.
        tool_row: row of the tree of the link that carries the tool.
        tool: origin of the tool in that link, m, shape (3,).
    """

    joints: tuple[str, ...]
    tree: Array
    tool_row: int
    tool: Array

    @property
    def parents(self) -> list[int]:
        """For each point of `points`, the index of the point before it on the arm; -1: the base."""
        return [*rows(self.tree)[:, Column.PARENT].astype(int).tolist(), self.tool_row]

    @property
    def sliding(self) -> list[int]:
        """Indices of those of `points` that belong to joints that slide."""
        return np.flatnonzero(rows(self.tree)[:, Column.SLIDES]).tolist()

    @property
    def places(self) -> list[int]:
        """Index in `joints` of the joint of each of `points` but the tool."""
        return rows(self.tree)[:, Column.PLACE].astype(int).tolist()

    def points(self, positions: Array) -> Array:
        """Origins of the joint frames after their motion, and last the tool; see `placed`."""
        return self.placed(positions)[0]

    def placed(self, positions: Array) -> tuple[Array, Array]:
        """Where the arm is, in the frame of the base.

        Args:
            positions: rad or m, shape (samples, joints).

        Returns:
            Origins of the joint frames after their motion, and last the tool, m, shape (samples, joints + 1, 3); and
            the rotations of these frames to the base, whose z axes are those of the joints, shape (samples, joints, 3,
            3); in the order of the rows of the tree.
        """
        tree, placements = self.tree.copy(), np.empty((len(self.joints), 3, 4))
        points = np.empty((len(positions), len(self.joints) + 1, 3))
        rotations = np.empty((len(positions), len(self.joints), 3, 3))
        for q, found, turned in zip(np.ascontiguousarray(positions), points, rotations, strict=True):
            forward_kinematics(q, tree, placements)
            found[:-1] = placements[:, :, 3]
            found[-1] = placements[self.tool_row] @ (*self.tool, 1.0)
            turned[:] = placements[:, :, :3]
        return points, rotations


def find_skeleton(parameters: Mapping[str, object]) -> Skeleton:
    """The skeleton of a robot.

    Args:
        parameters: of the robot, see `pidtsm_core.robots.robot_parameters`.

    Raises:
        ParameterError: it is not known; the message is one line.
    """
    if not parameters:
        raise ParameterError("the recording does not contain the parameters of the arm")
    robot = find_robot(parameters)
    if isinstance(robot, TreeRobot):
        return skeleton_of(robot.description)
    if robot is TWO_LINK:
        return _planar(parameters)
    raise ParameterError(f"robot.description: {robot.name} is a closed form, which has no positions of its joints")


def skeleton_of(arm: Description) -> Skeleton:
    """The skeleton of an arm that is described as a tree."""
    return Skeleton(arm.joints, arm.tree, arm.tool_row, arm.tool)


def _planar(parameters: Mapping[str, object]) -> Skeleton:
    """The two-link arm, in the plane of x and z."""
    known = {parameter.name for parameter in robot_schema(parameters)}
    values = resolve(robot_schema, {name: value for name, value in parameters.items() if name in known}, 2)
    tree = np.zeros(size(2))
    first, second = rows(tree)
    first[[Column.PARENT, Column.PLACE]] = -1, 0
    second[[Column.PARENT, Column.PLACE]] = 0, 1
    rotation(first)[:], rotation(second)[:] = _LIFTED, np.eye(3)
    second[Column.TRANSLATION] = as_float(values["robot.r1"])
    return Skeleton(names(values["joints"]), tree, 1, np.array([as_float(values["robot.r2"]), 0.0, 0.0]))
