"""Inertias of bodies that consist of several links, as symmetric 6 x 6 matrices ((A, B), (B', C)): see `Scratch`.

A and C are symmetric: xx, yy, zz, xy, xz, yz. B is general, row by row.

Shapes in this module: `p`, the tree, (size(joints),); `y`, its scratch, (joints * SPACE,).
"""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.robots.tree.layout import SPACE, Column, Scratch, row_of
from pidtsm_core.robots.tree.motion import out, put


@inlined
def begin_body(p: Array, y: Array, i: int) -> None:
    """Set the inertia of body i to that of its first link."""
    r, k = row_of(i), i * SPACE
    h, j = r + Column.MOMENT, r + Column.INERTIA
    m, h0, h1, h2 = p[r + Column.MASS], p[h], p[h + 1], p[h + 2]
    a, b, c = k + Scratch.ANGULAR, k + Scratch.MIXED, k + Scratch.LINEAR
    put(y, a, (p[j], p[j + 1], p[j + 2]))
    put(y, a + 3, (p[j + 3], p[j + 4], p[j + 5]))
    put(y, b, (0.0, -h2, h1))
    put(y, b + 3, (h2, 0.0, -h0))
    put(y, b + 6, (-h1, h0, 0.0))
    put(y, c, (m, m, m))
    put(y, c + 3, (0.0, 0.0, 0.0))


@inlined
def _turn(y: Array, k: int, s: int) -> None:
    """Replace the matrix M at `s` by R M R', with the rotation of the link whose scratch begins at `k`."""
    a0, a1, a2 = out(y, k, y[s], y[s + 3], y[s + 6])
    b0, b1, b2 = out(y, k, y[s + 1], y[s + 4], y[s + 7])
    c0, c1, c2 = out(y, k, y[s + 2], y[s + 5], y[s + 8])
    put(y, s, out(y, k, a0, b0, c0))
    put(y, s + 3, out(y, k, a1, b1, c1))
    put(y, s + 6, out(y, k, a2, b2, c2))


@inlined
def _turn_symmetric(y: Array, k: int, s: int) -> None:
    """The same for a symmetric matrix; the compiler omits what is not used."""
    xx, yy, zz, xy, xz, yz = y[s], y[s + 1], y[s + 2], y[s + 3], y[s + 4], y[s + 5]
    a0, a1, a2 = out(y, k, xx, xy, xz)
    b0, b1, b2 = out(y, k, xy, yy, yz)
    c0, c1, c2 = out(y, k, xz, yz, zz)
    y[s], y[s + 3], y[s + 4] = out(y, k, a0, b0, c0)
    _, y[s + 1], y[s + 5] = out(y, k, a1, b1, c1)
    _, _, y[s + 2] = out(y, k, a2, b2, c2)


@inlined
def _add_cross(y: Array, k: int) -> None:
    """Add [t] C to B, with the matrix [t] of t x."""
    t, b, c = k + Scratch.TRANSLATION, k + Scratch.MIXED, k + Scratch.LINEAR
    t0, t1, t2 = y[t], y[t + 1], y[t + 2]
    xx, yy, zz, xy, xz, yz = y[c], y[c + 1], y[c + 2], y[c + 3], y[c + 4], y[c + 5]
    y[b] += t1 * xz - t2 * xy
    y[b + 1] += t1 * yz - t2 * yy
    y[b + 2] += t1 * zz - t2 * yz
    y[b + 3] += t2 * xx - t0 * xz
    y[b + 4] += t2 * xy - t0 * yz
    y[b + 5] += t2 * xz - t0 * zz
    y[b + 6] += t0 * xy - t1 * xx
    y[b + 7] += t0 * yy - t1 * xy
    y[b + 8] += t0 * yz - t1 * xz


@inlined
def join_parent(y: Array, k: int, parent: int) -> None:
    """Add the inertia of a body (scratch at `k`) to that of its parent (scratch at `parent`), in the parent's frame.

    With the translation t, [t] the matrix of t x, and the blocks A, B, C in the parent's axes:
    A + [t] B' - (B + [t] C) [t], B + [t] C and C. Column j of [t] B' is t x (row j of B), row i of M [t] is
    (row i of M) x t.
    """
    a, b, c = k + Scratch.ANGULAR, k + Scratch.MIXED, k + Scratch.LINEAR
    _turn_symmetric(y, k, a)
    _turn(y, k, b)
    _turn_symmetric(y, k, c)
    t = k + Scratch.TRANSLATION
    t0, t1, t2 = y[t], y[t + 1], y[t + 2]
    pa, pb, pc = parent + Scratch.ANGULAR, parent + Scratch.MIXED, parent + Scratch.LINEAR
    b1, b2, b4, b5, b7, b8 = y[b + 1], y[b + 2], y[b + 4], y[b + 5], y[b + 7], y[b + 8]
    b3, b6 = y[b + 3], y[b + 6]
    _add_cross(y, k)
    m0, m1, m2, m3, m4, m5 = y[b], y[b + 1], y[b + 2], y[b + 3], y[b + 4], y[b + 5]
    m6, m7 = y[b + 6], y[b + 7]
    y[pa] += y[a] + (t1 * b2 - t2 * b1) - (m1 * t2 - m2 * t1)
    y[pa + 1] += y[a + 1] + (t2 * b3 - t0 * b5) - (m5 * t0 - m3 * t2)
    y[pa + 2] += y[a + 2] + (t0 * b7 - t1 * b6) - (m6 * t1 - m7 * t0)
    y[pa + 3] += y[a + 3] + (t1 * b5 - t2 * b4) - (m2 * t0 - m0 * t2)
    y[pa + 4] += y[a + 4] + (t1 * b8 - t2 * b7) - (m0 * t1 - m1 * t0)
    y[pa + 5] += y[a + 5] + (t2 * b6 - t0 * b8) - (m3 * t1 - m4 * t0)
    for j in range(9):
        y[pb + j] += y[b + j]
    for j in range(6):
        y[pc + j] += y[c + j]


@inlined
def multiply_subspace(y: Array, k: int, axis: int) -> None:
    """Compute the column of the inertia that belongs to the motion of the joint, U = I S."""
    u, a, b, c = k + Scratch.PRODUCT, k + Scratch.ANGULAR, k + Scratch.MIXED, k + Scratch.LINEAR
    if axis == 5:
        put(y, u, (y[b + 2], y[b + 5], y[b + 8]))
        put(y, u + 3, (y[c + 4], y[c + 5], y[c + 2]))
    else:
        put(y, u, (y[a + 4], y[a + 5], y[a + 2]))
        put(y, u + 3, (y[b + 6], y[b + 7], y[b + 8]))
