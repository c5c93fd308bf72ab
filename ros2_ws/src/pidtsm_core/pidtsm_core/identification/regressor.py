"""The regressor of an arm: its efforts are linear in inertias, armature and friction, effort = Y(q, q', q'') pi.

Khalil and Dombre, Modeling, Identification and Control of Robots (2002), chapter 12. The vector pi contains for each
joint, in the order of the joints, ten numbers of the link that it moves: mass, first moment of mass (3), and inertia
about the origin of the link frame (xx, yy, zz, xy, xz, yz), as in `tree.layout`; then for all joints the armature, then
viscous friction, then Coulomb friction, then a constant effort (offset).
"""

import math
from collections.abc import Sequence

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined, njit
from pidtsm_core.robots.tree.layout import ROW, SPACE, Column, Scratch, axis_of, parent_of, place_of, rows, scratch
from pidtsm_core.robots.tree.motion import accelerate_link, load_parent, move_links
from pidtsm_core.robots.tree.unit_forces import LINK, load_unit

OF_JOINT = ("armature", "viscous", "coulomb", "offset")
"""Parameters of a joint, in their order after those of the links."""
REVERSAL = 0.01
"""rad/s or m/s; below this velocity Coulomb friction goes to zero, as tanh, like that which the controller compensates.
"""
_OF_LINK = ("m", "mx", "my", "mz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")


def parameter_names(joints: Sequence[str]) -> tuple[str, ...]:
    """Names of the entries of pi, such as ``joint1.Izz`` or ``joint1.coulomb``."""
    links = [f"{joint}.{name}" for joint in joints for name in _OF_LINK]
    return (*links, *(f"{joint}.{name}" for name in OF_JOINT for joint in joints))


def described_parameters(tree: Array, viscous: Array, coulomb: Array) -> Array:
    """The vector pi of a description, without offsets, shape (14 joints,).

    Args:
        tree: see `tree.layout`, shape (size(joints),).
        viscous: viscous friction, shape (joints,), N m s/rad or N s/m.
        coulomb: Coulomb friction, shape (joints,), N m or N.
    """
    joints = viscous.size
    links, armature = np.empty((joints, LINK)), np.empty(joints)
    for row in rows(tree):
        place = int(row[Column.PLACE])
        links[place] = row[Column.MASS : Column.ARMATURE]
        armature[place] = row[Column.ARMATURE]
    return np.concatenate([links.ravel(), armature, viscous, coulomb, np.zeros(joints)])


def regressor(tree: Array, q: Array, dq: Array, ddq: Array) -> Array:
    """The matrices Y of many states, shape (samples, joints, 14 joints).

    Args:
        tree: geometry and gravity of the arm, see `tree.layout`, shape (size(joints),); its masses do not matter.
        q: shape (samples, joints), rad or m.
        dq: likewise, rad/s or m/s.
        ddq: likewise, rad/s^2 or m/s^2.
    """
    samples, joints = q.shape
    result = np.zeros((samples, joints, (LINK + len(OF_JOINT)) * joints))
    q, dq, ddq = (np.ascontiguousarray(each, dtype=np.float64) for each in (q, dq, ddq))
    _fill(q, dq, ddq, tree.copy(), np.zeros(ROW), result)
    return result


def coulomb_column(dq: Array) -> Array:
    """The factor of Coulomb friction at a velocity (rad/s or m/s), of the same shape."""
    return np.tanh(dq / REVERSAL)


@inlined
def _project(p: Array, y: Array, link: int, result: Array, column: int) -> None:
    """Write the efforts of the force at `MIXED` of a link to a column of `result`, shape (joints, columns)."""
    i = link
    while i >= 0:
        parent, force = parent_of(p, i), i * SPACE + Scratch.MIXED
        result[place_of(p, i), column] = y[force + axis_of(p, i)]
        if parent >= 0:
            above = parent * SPACE + Scratch.MIXED
            for m in range(6):
                y[above + m] = 0.0
            load_parent(y, i * SPACE, force, above)
        i = parent


@njit
def _fill(q: Array, dq: Array, ddq: Array, p: Array, unit: Array, result: Array) -> None:
    """Write the regressor of each state; `unit` are ROW zeros."""
    samples, joints = q.shape
    y = p[scratch(joints) :]
    for s in range(samples):
        move_links(q[s], dq[s], p, y)
        for i in range(joints):
            j = place_of(p, i)
            accelerate_link(p, y, i, dq[s, j])
            y[i * SPACE + Scratch.ACCELERATION + axis_of(p, i)] += ddq[s, j]
            for parameter in range(LINK):
                load_unit(unit, y, i, parameter)
                _project(p, y, i, result[s], LINK * j + parameter)
        for j in range(joints):
            result[s, j, LINK * joints + j] = ddq[s, j]
            result[s, j, (LINK + 1) * joints + j] = dq[s, j]
            result[s, j, (LINK + 2) * joints + j] = math.tanh(dq[s, j] / REVERSAL)
            result[s, j, (LINK + 3) * joints + j] = 1.0
