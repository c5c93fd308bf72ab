"""A drawing of an arm: its links and joints, seen along three axes."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots import TreeRobot, find_robot
from pidtsm_core.robots.placement import link_placements
from pidtsm_core.robots.tree.layout import Column, rows
from pidtsm_studies.reports.skeleton import find_skeleton

_VIEWS = {"from the side (x to the right, z up)": (0, 2), "from the front (y, z)": (1, 2), "from above (x, y)": (0, 1)}
_SIZE, _MARGIN = 300.0, 30.0
"""Size and margin of a view, px."""
_SHORTEST = 1e-3
"""Links that are shorter are not drawn, m."""


def drawing(settings: Mapping[str, object]) -> dict[str, Any]:
    """An arm with all joints in the middle of their ranges.

    Args:
        settings: parameters of the robot, see `find_robot`.

    Returns:
        Plain data for the template: ``size`` of a view (px), and ``views``, each with ``title``, ``others`` and ``arm``
        (lines, as paths of an SVG), ``joints`` (number, x, y, whether it slides), and ``tool`` (x, y).

    Raises:
        ParameterError: where the joints of the arm are is not known.
    """
    skeleton, robot = find_skeleton(settings), find_robot(settings)
    q = np.array(robot.initial_position)
    points = np.concatenate([np.zeros((1, 3)), skeleton.points(q[np.newaxis])[0]])
    lines = [(points[parent + 1], point) for parent, point in zip(skeleton.parents, points[1:], strict=True)]
    others = _links(robot, q) if isinstance(robot, TreeRobot) else []
    every = np.concatenate([points, *(np.array(line) for line in others)])
    low, high = every.min(axis=0), every.max(axis=0)
    scale = (_SIZE - 2.0 * _MARGIN) / max(float((high - low).max()), _SHORTEST)
    middle = 0.5 * (low + high)

    def place(point: Array, axes: tuple[int, int]) -> tuple[float, float]:
        right, up = (scale * float(point[axis] - middle[axis]) for axis in axes)
        return round(0.5 * _SIZE + right, 1), round(0.5 * _SIZE - up, 1)

    def path(pairs: list[tuple[Array, Array]], axes: tuple[int, int]) -> str:
        ends = [(place(start, axes), place(end, axes)) for start, end in pairs]
        return "".join(f"M{x} {y}L{u} {v}" for (x, y), (u, v) in ends)

    numbers = [int(row[Column.PLACE]) + 1 for row in rows(skeleton.tree)]
    return {
        "size": _SIZE,
        "views": [
            {
                "title": title,
                "others": path(others, axes),
                "arm": path(lines, axes),
                "joints": [
                    (number, *place(point, axes), index in skeleton.sliding)
                    for index, (number, point) in enumerate(zip(numbers, points[1:-1], strict=True))
                ],
                "tool": place(points[-1], axes),
            }
            for title, axes in _VIEWS.items()
        ],
    }


def _links(robot: TreeRobot, q: Array) -> list[tuple[Array, Array]]:
    """Lines from each link to those on it, which also shows what does not move."""
    arm = robot.description
    origins = link_placements(arm, q)[:, :, 3]
    pairs = [(origins[parent], origins[link]) for link, parent in enumerate(arm.links.parents) if parent >= 0]
    return [pair for pair in pairs if np.linalg.norm(pair[1] - pair[0]) > _SHORTEST]
