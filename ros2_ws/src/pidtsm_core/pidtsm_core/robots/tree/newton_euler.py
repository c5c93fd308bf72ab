"""Inverse dynamics of a tree: recursive Newton-Euler algorithm, Featherstone (2008), table 5.1."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import subroutine
from pidtsm_core.robots.tree.layout import SPACE, Column, Scratch, axis_of, parent_of, place_of, row_of, scratch
from pidtsm_core.robots.tree.motion import accelerate_link, load_parent, move_links, multiply_inertia


@subroutine
def inverse_dynamics(q: Array, dq: Array, ddq: Array, p: Array, effort: Array) -> None:
    """Efforts of several accelerations in one state.

    Args:
        q: shape (joints,), rad or m.
        dq: shape (joints,), rad/s or m/s.
        ddq: shape (rows, joints), rad/s^2 or m/s^2.
        p: the tree, shape (size(joints),), see `layout`; its scratch is overwritten.
        effort: result, shape (rows, joints), N m or N.
    """
    joints = q.size
    y = p[scratch(joints) :]
    move_links(q, dq, p, y)
    for row in range(ddq.shape[0]):
        for i in range(joints):
            k, j = i * SPACE, place_of(p, i)
            a, f = k + Scratch.ACCELERATION, k + Scratch.FORCE
            accelerate_link(p, y, i, dq[j])
            y[a + axis_of(p, i)] += ddq[row, j]
            multiply_inertia(p, row_of(i), y, a, f)
            for m in range(6):
                y[f + m] += y[k + Scratch.BIAS + m]
        for i in range(joints - 1, -1, -1):
            k, j, parent = i * SPACE, place_of(p, i), parent_of(p, i)
            f = k + Scratch.FORCE
            effort[row, j] = y[f + axis_of(p, i)] + p[row_of(i) + Column.ARMATURE] * ddq[row, j]
            if parent >= 0:
                load_parent(y, k, f, parent * SPACE + Scratch.FORCE)
