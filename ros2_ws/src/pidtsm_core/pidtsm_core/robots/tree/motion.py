"""Placements, velocities and accelerations of the links, and forces from link to link.

Shapes in this module: `p`, the tree, (size(joints),); `y`, its scratch, (joints * SPACE,).
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.robots.tree.layout import SPACE, Column, Scratch, axis_of, parent_of, place_of, row_of


@inlined
def into(y: Array, k: int, a: float, b: float, c: float) -> tuple[float, float, float]:
    """Express a vector of the parent frame in the link frame: R' (a, b, c); `k` is the begin of the link's scratch."""
    return (
        y[k] * a + y[k + 3] * b + y[k + 6] * c,
        y[k + 1] * a + y[k + 4] * b + y[k + 7] * c,
        y[k + 2] * a + y[k + 5] * b + y[k + 8] * c,
    )


@inlined
def out(y: Array, k: int, a: float, b: float, c: float) -> tuple[float, float, float]:
    """Express a vector of the link frame in the parent frame: R (a, b, c)."""
    return (
        y[k] * a + y[k + 1] * b + y[k + 2] * c,
        y[k + 3] * a + y[k + 4] * b + y[k + 5] * c,
        y[k + 6] * a + y[k + 7] * b + y[k + 8] * c,
    )


@inlined
def put(y: Array, k: int, values: tuple[float, float, float]) -> None:
    """Write three numbers."""
    y[k], y[k + 1], y[k + 2] = values


@inlined
def place_link(p: Array, y: Array, i: int, q: float) -> None:
    """Compute rotation and translation of link i to its parent."""
    r, k = row_of(i), i * SPACE
    slides = p[r + Column.SLIDES] != 0.0
    c, s = (1.0, 0.0) if slides else (math.cos(q), math.sin(q))
    d = q if slides else 0.0
    for m in range(3):
        n = r + Column.ROTATION + 3 * m
        x, y_, z = p[n], p[n + 1], p[n + 2]
        put(y, k + 3 * m, (c * x + s * y_, c * y_ - s * x, z))
        y[k + Scratch.TRANSLATION + m] = p[r + Column.TRANSLATION + m] + z * d


@inlined
def carry_motion(y: Array, k: int, source: int, target: int) -> None:
    """Express the motion of the parent link (at `source`) in the link frame, to `target`."""
    t = k + Scratch.TRANSLATION
    w0, w1, w2 = y[source], y[source + 1], y[source + 2]
    u0 = y[source + 3] + w1 * y[t + 2] - w2 * y[t + 1]
    u1 = y[source + 4] + w2 * y[t] - w0 * y[t + 2]
    u2 = y[source + 5] + w0 * y[t + 1] - w1 * y[t]
    put(y, target, into(y, k, w0, w1, w2))
    put(y, target + 3, into(y, k, u0, u1, u2))


@inlined
def load_parent(y: Array, k: int, source: int, target: int) -> None:
    """Add the force on a link (at `source`) to that on its parent (at `target`)."""
    t = k + Scratch.TRANSLATION
    n0, n1, n2 = out(y, k, y[source], y[source + 1], y[source + 2])
    f0, f1, f2 = out(y, k, y[source + 3], y[source + 4], y[source + 5])
    y[target] += n0 + y[t + 1] * f2 - y[t + 2] * f1
    y[target + 1] += n1 + y[t + 2] * f0 - y[t] * f2
    y[target + 2] += n2 + y[t] * f1 - y[t + 1] * f0
    y[target + 3] += f0
    y[target + 4] += f1
    y[target + 5] += f2


@inlined
def multiply_inertia(p: Array, r: int, y: Array, source: int, target: int) -> None:
    """Multiply the inertia of the link of row `r` by the motion at `source`, to `target`."""
    w0, w1, w2 = y[source], y[source + 1], y[source + 2]
    u0, u1, u2 = y[source + 3], y[source + 4], y[source + 5]
    h, j = r + Column.MOMENT, r + Column.INERTIA
    m, h0, h1, h2 = p[r + Column.MASS], p[h], p[h + 1], p[h + 2]
    xx, yy, zz, xy, xz, yz = p[j], p[j + 1], p[j + 2], p[j + 3], p[j + 4], p[j + 5]
    y[target] = xx * w0 + xy * w1 + xz * w2 + h1 * u2 - h2 * u1
    y[target + 1] = xy * w0 + yy * w1 + yz * w2 + h2 * u0 - h0 * u2
    y[target + 2] = xz * w0 + yz * w1 + zz * w2 + h0 * u1 - h1 * u0
    y[target + 3] = m * u0 - h1 * w2 + h2 * w1
    y[target + 4] = m * u1 - h2 * w0 + h0 * w2
    y[target + 5] = m * u2 - h0 * w1 + h1 * w0


@inlined
def move_links(q: Array, dq: Array, p: Array, y: Array) -> None:
    """Compute placements, velocities and bias forces v x* I v of all links."""
    for i in range(q.size):
        k, j, parent = i * SPACE, place_of(p, i), parent_of(p, i)
        v, b, f = k + Scratch.VELOCITY, k + Scratch.BIAS, k + Scratch.FORCE
        place_link(p, y, i, q[j])
        if parent < 0:
            for m in range(6):
                y[v + m] = 0.0
        else:
            carry_motion(y, k, parent * SPACE + Scratch.VELOCITY, v)
        y[v + axis_of(p, i)] += dq[j]
        multiply_inertia(p, row_of(i), y, v, f)
        w0, w1, w2, u0, u1, u2 = y[v], y[v + 1], y[v + 2], y[v + 3], y[v + 4], y[v + 5]
        n0, n1, n2, f0, f1, f2 = y[f], y[f + 1], y[f + 2], y[f + 3], y[f + 4], y[f + 5]
        y[b] = w1 * n2 - w2 * n1 + u1 * f2 - u2 * f1
        y[b + 1] = w2 * n0 - w0 * n2 + u2 * f0 - u0 * f2
        y[b + 2] = w0 * n1 - w1 * n0 + u0 * f1 - u1 * f0
        y[b + 3] = w1 * f2 - w2 * f1
        y[b + 4] = w2 * f0 - w0 * f2
        y[b + 5] = w0 * f1 - w1 * f0


@inlined
def velocity_product(y: Array, v: int, axis: int, dq: float) -> tuple[float, float, float, float]:
    """Entries 0, 1, 3, 4 of v x S q', the acceleration due to the velocity of the joint; entries 2 and 5 are zero."""
    if axis == 5:
        return 0.0, 0.0, y[v + 1] * dq, -y[v] * dq
    return y[v + 1] * dq, -y[v] * dq, y[v + 4] * dq, -y[v + 3] * dq


@inlined
def accelerate_link(p: Array, y: Array, i: int, dq: float) -> None:
    """Compute the acceleration of link i without that of its joint; gravity is an acceleration of the base."""
    k, parent = i * SPACE, parent_of(p, i)
    v, a = k + Scratch.VELOCITY, k + Scratch.ACCELERATION
    if parent < 0:
        put(y, a, (0.0, 0.0, 0.0))
        put(y, a + 3, into(y, k, -p[0], -p[1], -p[2]))
    else:
        carry_motion(y, k, parent * SPACE + Scratch.ACCELERATION, a)
    c0, c1, c3, c4 = velocity_product(y, v, axis_of(p, i), dq)
    y[a] += c0
    y[a + 1] += c1
    y[a + 3] += c3
    y[a + 4] += c4
