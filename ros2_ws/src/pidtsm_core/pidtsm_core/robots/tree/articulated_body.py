"""Forward dynamics of a tree: articulated-body algorithm, Featherstone (2008), table 7.1."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined, subroutine
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
    inverse = 1.0 / inertia  # Divisions are the most expensive operations here.
    _subtract_square(y, k, inverse)
    c0, c1, c3, c4 = velocity_product(y, k + Scratch.VELOCITY, axis, dq)
    rate = net * inverse
    a, o, c = k + Scratch.ANGULAR, k + Scratch.MIXED, k + Scratch.LINEAR
    y[b] += y[a] * c0 + y[a + 3] * c1 + y[o] * c3 + y[o + 1] * c4 + y[u] * rate
    y[b + 1] += y[a + 3] * c0 + y[a + 1] * c1 + y[o + 3] * c3 + y[o + 4] * c4 + y[u + 1] * rate
    y[b + 2] += y[a + 4] * c0 + y[a + 5] * c1 + y[o + 6] * c3 + y[o + 7] * c4 + y[u + 2] * rate
    y[b + 3] += y[o] * c0 + y[o + 3] * c1 + y[c] * c3 + y[c + 3] * c4 + y[u + 3] * rate
    y[b + 4] += y[o + 1] * c0 + y[o + 4] * c1 + y[c + 3] * c3 + y[c + 1] * c4 + y[u + 4] * rate
    y[b + 5] += y[o + 2] * c0 + y[o + 5] * c1 + y[c + 4] * c3 + y[c + 5] * c4 + y[u + 5] * rate


@inlined
def _subtract_square(y: Array, k: int, inverse: float) -> None:
    """Subtract U U' times `inverse` from the inertia."""
    u, a, o, c = k + Scratch.PRODUCT, k + Scratch.ANGULAR, k + Scratch.MIXED, k + Scratch.LINEAR
    u0, u1, u2, u3, u4, u5 = y[u], y[u + 1], y[u + 2], y[u + 3], y[u + 4], y[u + 5]
    s0, s1, s2, s3, s4, s5 = u0 * inverse, u1 * inverse, u2 * inverse, u3 * inverse, u4 * inverse, u5 * inverse
    for symmetric, v0, v1, v2, w0, w1, w2 in ((a, u0, u1, u2, s0, s1, s2), (c, u3, u4, u5, s3, s4, s5)):
        y[symmetric] -= w0 * v0
        y[symmetric + 1] -= w1 * v1
        y[symmetric + 2] -= w2 * v2
        y[symmetric + 3] -= w0 * v1
        y[symmetric + 4] -= w0 * v2
        y[symmetric + 5] -= w1 * v2
    for row, w in ((o, s0), (o + 3, s1), (o + 6, s2)):
        y[row] -= w * u3
        y[row + 1] -= w * u4
        y[row + 2] -= w * u5
