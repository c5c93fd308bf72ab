"""What pictures of an arm show: its size, and an arc or an arrow for each effort."""

import math

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots.description import Description, Links
from pidtsm_core.robots.placement import link_placements

# Lengths as shares of the reach of the arm.
BONE_WIDTH = 0.02
"""Of the lines from link to link."""
_ARC_RADIUS = 0.1
_ARROW_LENGTH = 0.25  # for an effort at its limit

ARM_COLOR = 0.15, 0.3, 0.5, 1.0
GHOST_COLOR = 0.4, 0.4, 0.4, 0.5
"""Red, green, blue and opacity of the arm, and of the arm that shows the reference."""

_FULL_ARC = 1.5 * math.pi  # rad, for an effort at its limit
_ARC_POINTS = 24


def reach(arm: Description) -> float:
    """Longest way along the links from the base to another link, m, with all joints at 0."""
    links, placements = arm.links, link_placements(arm, np.zeros(len(arm.joints)))
    way = np.zeros(len(links.names))
    for link, parent in enumerate(links.parents[1:], start=1):
        way[link] = way[parent] + np.linalg.norm(placements[link, :, 3] - placements[parent, :, 3])
    return float(way.max())


def bones(links: Links, placements: Array) -> Array:
    """Lines from link to link, for viewers without meshes: both ends of each, shape (2 (links - 1), 3), m.

    Args:
        links: the links.
        placements: as returned by `link_placements`, shape (links, 3, 4).
    """
    origins = placements[:, :, 3]
    return np.stack([origins[links.parents[1:]], origins[1:]], axis=1).reshape(-1, 3)


def effort_shares(arm: Description, efforts: Array) -> Array:
    """Efforts as shares of their limits, -1 to 1, shape (joints,); nan for a joint without an effort or a limit.

    Args:
        arm: the arm.
        efforts: in the order of the joints, shape (joints,), N m or N; nan: none.
    """
    return np.clip(efforts / np.where(np.isfinite(arm.effort), arm.effort, np.nan), -1.0, 1.0)


def effort_color(share: float) -> tuple[float, float, float]:
    """Red, green and blue, 0 to 1: from green to red at the limit."""
    return abs(share), 1.0 - abs(share), 0.0


def effort_arc(placement: Array, share: float, size: float) -> Array:
    """An arc about a joint that turns, in the direction of its effort, shape (points, 3), m.

    Args:
        placement: of the frame that the joint moves, see `joint_placements`, shape (3, 4).
        share: of the effort in its limit, see `effort_shares`.
        size: reach of the arm, m.
    """
    # From the y axis of the frame, which is the x axis of a link that turns about its y or z axis.
    angles = np.linspace(0.0, share * _FULL_ARC, _ARC_POINTS)
    circle = np.stack([-np.sin(angles), np.cos(angles), np.zeros(_ARC_POINTS)], axis=1)
    return np.asarray(_ARC_RADIUS * size * circle @ placement[:, :3].T + placement[:, 3])


def effort_arrow(placement: Array, share: float, size: float) -> Array:
    """Both ends of an arrow along a joint that slides, in the direction of its effort, shape (2, 3), m.

    Arguments as for `effort_arc`.
    """
    start = placement[:, 3]
    return np.stack([start, start + _ARROW_LENGTH * share * size * placement[:, 2]])
