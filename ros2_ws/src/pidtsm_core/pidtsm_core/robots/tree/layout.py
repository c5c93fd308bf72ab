"""The flat array that describes an arm as a tree of joints, for compiled code.

The array consists of the acceleration of gravity, one row per joint, and scratch space, which the functions overwrite.
Whoever calls the functions needs an array of their own; its length depends on the number of joints, its type does not,
so no arm requires a compilation.

In the array, a parent has a lower index than its children. Joint i turns about, or slides along, the z axis of its
frame; the frame of link i is that of joint i after the motion. Spatial vectors consist of the angular part and the
linear part, at the origin of a link frame and in its axes.

The algorithms are those of R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008 (page and table numbers refer
to it), written in scalars, because the motion subspace of every joint is a unit vector.
"""

from enum import IntEnum

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined


class Column(IntEnum):
    """What the row of a joint contains."""

    SLIDES = 0  # 1: prismatic, 0: revolute
    PARENT = 1  # row of the joint that moves the parent link; -1: the base
    PLACE = 2  # index of the joint in positions, velocities and efforts
    ROTATION = 3  # 9 numbers, row by row: from the joint frame to the frame of the parent link at q = 0
    TRANSLATION = 12  # 3 numbers: origin of the joint frame in the parent link, m
    MASS = 15  # kg
    MOMENT = 16  # 3 numbers: mass times centre of mass in the link frame, kg m
    INERTIA = 19  # 6 numbers: xx, yy, zz, xy, xz, yz about the origin of the link frame, kg m^2
    ARMATURE = 25  # inertia of the rotor as the joint sees it, kg m^2 or kg


class Scratch(IntEnum):
    """What the scratch space of a joint contains."""

    ROTATION = 0  # 9 numbers: from the link frame to that of its parent
    TRANSLATION = 9  # 3 numbers: likewise, m
    VELOCITY = 12  # 6 numbers
    BIAS = 18  # 6 numbers: force v x* I v, in forward dynamics the bias force of the articulated body
    ACCELERATION = 24  # 6 numbers
    FORCE = 30  # 6 numbers
    ANGULAR = 36  # 6 numbers: articulated or composite inertia ((ANGULAR, MIXED), (MIXED', LINEAR)), see body_inertia
    MIXED = 42  # 9 numbers
    LINEAR = 51  # 6 numbers
    PRODUCT = 57  # 6 numbers: inertia times motion subspace, U = I S


GRAVITY = 3
"""Numbers before the first row: the acceleration of gravity in the base frame, m/s^2."""
ROW = 26
SPACE = 63


def size(joints: int) -> int:
    """Length of the array for this number of joints."""
    return GRAVITY + joints * (ROW + SPACE)


def rows(tree: Array) -> Array:
    """The rows of the array as a view, shape (joints, ROW)."""
    joints = (tree.size - GRAVITY) // (ROW + SPACE)
    return tree[GRAVITY : GRAVITY + joints * ROW].reshape(joints, ROW)


def rotation(row: Array) -> Array:
    """The rotation in a row, as a view of shape (3, 3)."""
    return row[Column.ROTATION : Column.TRANSLATION].reshape(3, 3)


def inertia_matrix(row: Array) -> Array:
    """Rotational inertia about the origin of the link frame, shape (3, 3), kg m^2."""
    xx, yy, zz, xy, xz, yz = row[Column.INERTIA : Column.ARMATURE]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def steiner(center: Array) -> Array:
    """Inertia of 1 kg at a point, about the origin, shape (3, 3), m^2."""
    return np.asarray(center @ center * np.eye(3) - np.outer(center, center))


def set_inertia(row: Array, inertia: Array) -> None:
    """Write a rotational inertia, shape (3, 3), to a row."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia
    row[Column.INERTIA : Column.ARMATURE] = xx, yy, zz, xy, xz, yz


@inlined
def scratch(joints: int) -> int:
    """Where the scratch space begins."""
    return GRAVITY + joints * ROW


@inlined
def row_of(i: int) -> int:
    """Where row i begins."""
    return GRAVITY + i * ROW


@inlined
def parent_of(p: Array, i: int) -> int:
    """Row of the joint that moves the parent link of joint i; -1: the base; `p` has shape (size(joints),)."""
    return int(p[GRAVITY + i * ROW + Column.PARENT])


@inlined
def place_of(p: Array, i: int) -> int:
    """Index of joint i in positions, velocities and efforts; `p` has shape (size(joints),)."""
    return int(p[GRAVITY + i * ROW + Column.PLACE])


@inlined
def axis_of(p: Array, i: int) -> int:
    """Entry of a spatial vector that joint i moves: 2, rotation about z, or 5, translation along z.

    `p` has shape (size(joints),).
    """
    return 5 if p[GRAVITY + i * ROW + Column.SLIDES] != 0.0 else 2
