"""Where the joints and links of a description are, for pictures."""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots.description import Description, Links
from pidtsm_core.robots.tree import forward_kinematics
from pidtsm_core.robots.tree.layout import Column, rows


def joint_placements(arm: Description, q: Array) -> Array:
    """Placements of the frames that the joints move, whose z axes are the axes of the joints.

    Args:
        arm: the arm.
        q: positions in the order of its joints, shape (joints,), rad or m.

    Returns:
        From each frame to the base, shape (joints, 3, 4), in the order of the joints: rotation and, in the last column,
        translation (m).
    """
    return _row_placements(arm, q)[np.argsort(rows(arm.tree)[:, Column.PLACE])]


def link_placements(arm: Description, q: Array) -> Array:
    """Placements of all links, also of those behind fixed and locked joints.

    Args:
        arm: the arm.
        q: positions in the order of its joints, shape (joints,), rad or m.

    Returns:
        From the frame of each link to the base, shape (links, 3, 4), in the order of `Description.links`: rotation and,
        in the last column, translation (m).
    """
    # The base comes last, where row -1 finds it.
    carriers = np.concatenate([_row_placements(arm, q), np.eye(3, 4)[np.newaxis]])[arm.links.rows]
    placements = carriers[:, :, :3] @ arm.links.placements
    placements[:, :, 3] += carriers[:, :, 3]
    return placements


def relative_placements(links: Links, placements: Array) -> Array:
    """Placement of each link relative to its parent, shape (links, 3, 4); that of the base is the identity.

    Args:
        links: the links.
        placements: as returned by `link_placements`, shape (links, 3, 4).
    """
    parents = placements[np.maximum(links.parents, 0)]
    inverse = parents[:, :, :3].transpose(0, 2, 1)
    relative = inverse @ placements
    relative[:, :, 3:] = inverse @ (placements - parents)[:, :, 3:]
    return np.asarray(relative)


def _row_placements(arm: Description, q: Array) -> Array:
    """Placements in the order of the rows of the tree, shape (joints, 3, 4)."""
    placements = np.empty((len(arm.joints), 3, 4))
    forward_kinematics(q, arm.tree.copy(), placements)  # A copy, since its scratch is overwritten.
    return placements
