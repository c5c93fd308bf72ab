"""Forward dynamics of a tree: articulated-body algorithm, Featherstone (2008), table 7.1."""

from pidtsm_core.compiled import inlined, subroutine
from pidtsm_core.parameters import Array
from pidtsm_core.robots.tree.body_inertia import begin_body, join_parent, multiply_subspace
from pidtsm_core.robots.tree.layout import SPACE, Column, Scratch, axis_of, parent_of, place_of, row_of, scratch
from pidtsm_core.robots.tree.motion import accelerate_link, load_parent, move_links, velocity_product


@subroutine
def forward_dynamics(q: Array, dq: Array, effort: Array, p: Array, ddq: Array) -> None:
    """Accelerations under given efforts.

    Args:
        q: shape (joints,), rad or m.
        dq: shape (joints,), rad/s or m/s.
        effort: shape (joints,), N m or N.
        p: the tree, shape (size(joints),), see `layout`; its scratch is overwritten.
        ddq: result, shape (joints,), rad/s^2 or m/s^2.
    """
    joints = q.size
    y = p[scratch(joints) :]
    move_links(q, dq, p, y)
    for i in range(joints):
        begin_body(p, y, i)
    for i in range(joints - 1, -1, -1):
        k, j, axis, parent = i * SPACE, place_of(p, i), axis_of(p, i), parent_of(p, i)
        multiply_subspace(y, k, axis)
        inertia = y[k + Scratch.PRODUCT + axis] + p[row_of(i) + Column.ARMATURE]
        net = effort[j] - y[k + Scratch.BIAS + axis]
        ddq[j] = net / inertia
        if parent >= 0:
            _release_joint(y, k, dq[j], axis, inertia, net)
            load_parent(y, k, k + Scratch.BIAS, parent * SPACE + Scratch.BIAS)
            join_parent(y, k, parent * SPACE)
    for i in range(joints):
        k, j, axis = i * SPACE, place_of(p, i), axis_of(p, i)
        u, a = k + Scratch.PRODUCT, k + Scratch.ACCELERATION
        accelerate_link(p, y, i, dq[j])
        along = 0.0
        for m in range(6):
            along += y[u + m] * y[a + m]
        ddq[j] -= along / (y[u + axis] + p[row_of(i) + Column.ARMATURE])
        y[a + axis] += ddq[j]


@inlined
def _release_joint(y: Array, k: int, dq: float, axis: int, inertia: float, net: float) -> None:
    """Compute what a body with a free joint passes to its parent: I - U U' / D, and p + I c + U net / D with this I."""
    u, b = k + Scratch.PRODUCT, k + Scratch.BIAS
    a, o, c = k + Scratch.ANGULAR, k + Scratch.MIXED, k + Scratch.LINEAR
    inverse = 1.0 / inertia  # Divisions are the most expensive operations here.
    for i in range(3):
        angular, linear = y[u + i] * inverse, y[u + 3 + i] * inverse
        for j in range(3):
            y[a + 3 * i + j] -= angular * y[u + j]
            y[o + 3 * i + j] -= angular * y[u + 3 + j]
            y[c + 3 * i + j] -= linear * y[u + 3 + j]
    c0, c1, c3, c4 = velocity_product(y, k + Scratch.VELOCITY, axis, dq)
    rate = net * inverse
    for m in range(3):
        n = 3 * m
        y[b + m] += y[a + n] * c0 + y[a + n + 1] * c1 + y[o + n] * c3 + y[o + n + 1] * c4 + y[u + m] * rate
        y[b + 3 + m] += y[o + m] * c0 + y[o + 3 + m] * c1 + y[c + n] * c3 + y[c + n + 1] * c4 + y[u + 3 + m] * rate
