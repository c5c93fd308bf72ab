"""Inertia matrix of a tree: composite-rigid-body algorithm, Featherstone (2008), table 6.2."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import subroutine
from pidtsm_core.robots.tree.body_inertia import begin_body, join_parent, multiply_subspace
from pidtsm_core.robots.tree.layout import SPACE, Column, Scratch, axis_of, parent_of, place_of, row_of, scratch
from pidtsm_core.robots.tree.motion import load_parent, place_link


@subroutine
def inertia_matrix(q: Array, p: Array, inertia: Array) -> None:
    """H(q), including the armature.

    Args:
        q: shape (joints,), rad or m.
        p: the tree, shape (size(joints),), see `layout`; its scratch is overwritten.
        inertia: result, shape (joints, joints), kg m^2, kg m or kg.
    """
    joints = q.size
    y = p[scratch(joints) :]
    for i in range(joints):
        place_link(p, y, i, q[place_of(p, i)])
        begin_body(p, y, i)
        for j in range(joints):
            inertia[i, j] = 0.0
    for i in range(joints - 1, -1, -1):
        k, row, axis = i * SPACE, place_of(p, i), axis_of(p, i)
        multiply_subspace(y, k, axis)
        inertia[row, row] = y[k + Scratch.PRODUCT + axis] + p[row_of(i) + Column.ARMATURE]
        for m in range(6):
            y[k + Scratch.FORCE + m] = y[k + Scratch.PRODUCT + m]
        child, parent = i, parent_of(p, i)
        while parent >= 0:
            force = parent * SPACE + Scratch.FORCE
            for m in range(6):
                y[force + m] = 0.0
            load_parent(y, child * SPACE, child * SPACE + Scratch.FORCE, force)
            column = place_of(p, parent)
            inertia[row, column] = inertia[column, row] = y[force + axis_of(p, parent)]
            child, parent = parent, parent_of(p, parent)
        parent = parent_of(p, i)
        if parent >= 0:
            join_parent(y, k, parent * SPACE)
