"""Inertias of bodies that consist of several links, as 6 x 6 matrices in three blocks of 3 x 3: see `Scratch`.

Shapes in this module: `p`, the tree, (size(joints),); `y`, its scratch, (joints * SPACE,).
"""

from pidtsm_core.compiled import inlined
from pidtsm_core.parameters import Array
from pidtsm_core.robots.tree.layout import SPACE, Column, Scratch, row_of
from pidtsm_core.robots.tree.motion import out, put


@inlined
def begin_body(p: Array, y: Array, i: int) -> None:
    """Set the inertia of body i to that of its first link."""
    r, k = row_of(i), i * SPACE
    h, j = r + Column.MOMENT, r + Column.INERTIA
    xx, yy, zz, xy, xz, yz = p[j], p[j + 1], p[j + 2], p[j + 3], p[j + 4], p[j + 5]
    m, h0, h1, h2 = p[r + Column.MASS], p[h], p[h + 1], p[h + 2]
    a, b, c = k + Scratch.ANGULAR, k + Scratch.MIXED, k + Scratch.LINEAR
    put(y, a, (xx, xy, xz))
    put(y, a + 3, (xy, yy, yz))
    put(y, a + 6, (xz, yz, zz))
    put(y, b, (0.0, -h2, h1))
    put(y, b + 3, (h2, 0.0, -h0))
    put(y, b + 6, (-h1, h0, 0.0))
    put(y, c, (m, 0.0, 0.0))
    put(y, c + 3, (0.0, m, 0.0))
    put(y, c + 6, (0.0, 0.0, m))


@inlined
def _turn(y: Array, k: int, s: int) -> None:
    """Replace the matrix M at `s` by R M R', with the rotation of the link whose scratch begins at `k`."""
    for row in range(s, s + 9, 3):
        put(y, row, out(y, k, y[row], y[row + 1], y[row + 2]))
    for column in range(s, s + 3):
        a, b, c = out(y, k, y[column], y[column + 3], y[column + 6])
        y[column], y[column + 3], y[column + 6] = a, b, c


@inlined
def join_parent(y: Array, k: int, parent: int) -> None:
    """Add the inertia of a body (scratch at `k`) to that of its parent (scratch at `parent`), in the parent's frame.

    With the translation t, [t] the matrix of t x, and the blocks A, B, C in the parent's axes:
    A + [t] B' - (B + [t] C) [t], B + [t] C and C.
    """
    a, b, c = k + Scratch.ANGULAR, k + Scratch.MIXED, k + Scratch.LINEAR
    _turn(y, k, a)
    _turn(y, k, b)
    _turn(y, k, c)
    t = k + Scratch.TRANSLATION
    x0, x1, x2 = y[t], y[t + 1], y[t + 2]
    pa, pb, pc = parent + Scratch.ANGULAR, parent + Scratch.MIXED, parent + Scratch.LINEAR
    for j in range(3):
        # Column j of [t] B' is t x (row j of B).
        b0, b1, b2 = y[b + 3 * j], y[b + 3 * j + 1], y[b + 3 * j + 2]
        y[pa + j] += y[a + j] + x1 * b2 - x2 * b1
        y[pa + 3 + j] += y[a + 3 + j] + x2 * b0 - x0 * b2
        y[pa + 6 + j] += y[a + 6 + j] + x0 * b1 - x1 * b0
    for j in range(3):
        c0, c1, c2 = y[c + j], y[c + 3 + j], y[c + 6 + j]
        y[b + j] += x1 * c2 - x2 * c1
        y[b + 3 + j] += x2 * c0 - x0 * c2
        y[b + 6 + j] += x0 * c1 - x1 * c0
    for j in range(9):
        y[pb + j] += y[b + j]
        y[pc + j] += y[c + j]
    for j in range(3):
        # Row j of (B + [t] C) [t] is (row j) x t.
        m0, m1, m2 = y[b + 3 * j], y[b + 3 * j + 1], y[b + 3 * j + 2]
        y[pa + 3 * j] -= m1 * x2 - m2 * x1
        y[pa + 3 * j + 1] -= m2 * x0 - m0 * x2
        y[pa + 3 * j + 2] -= m0 * x1 - m1 * x0


@inlined
def multiply_subspace(y: Array, k: int, axis: int) -> None:
    """Compute the column of the inertia that belongs to the motion of the joint, U = I S."""
    u = k + Scratch.PRODUCT
    for m in range(3):
        if axis == 5:
            y[u + m] = y[k + Scratch.MIXED + 3 * m + 2]
            y[u + 3 + m] = y[k + Scratch.LINEAR + 3 * m + 2]
        else:
            y[u + m] = y[k + Scratch.ANGULAR + 3 * m + 2]
            y[u + 3 + m] = y[k + Scratch.MIXED + 6 + m]
