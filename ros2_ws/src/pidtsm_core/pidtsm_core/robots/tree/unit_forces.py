"""Forces on a link that one of its parameters causes: the dynamics are linear in them.

Khalil and Dombre, Modeling, Identification and Control of Robots, 2002, chapter 12.
"""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.robots.tree.layout import SPACE, Column, Scratch
from pidtsm_core.robots.tree.motion import multiply_inertia

LINK = 10
"""Parameters of a link: mass, first moment of mass (3), inertia about the origin of its frame (6), see `Column`."""


@inlined
def load_unit(unit: Array, y: Array, link: int, parameter: int) -> None:
    """Write the force that a link needs if this parameter is 1 and all others are 0 to its scratch at `MIXED`.

    f = I a + v x* I v; the momentum I v is at `ANGULAR`.

    Args:
        unit: zeros, shape (ROW,).
        y: scratch of the tree, with velocities and accelerations of the links, shape (joints * SPACE,).
        link: row of the link.
        parameter: which of its LINK parameters.
    """
    k = link * SPACE
    v, h, f = k + Scratch.VELOCITY, k + Scratch.ANGULAR, k + Scratch.MIXED
    unit[Column.MASS + parameter] = 1.0
    multiply_inertia(unit, 0, y, v, h)
    multiply_inertia(unit, 0, y, k + Scratch.ACCELERATION, f)
    unit[Column.MASS + parameter] = 0.0
    w0, w1, w2, u0, u1, u2 = y[v], y[v + 1], y[v + 2], y[v + 3], y[v + 4], y[v + 5]
    n0, n1, n2, f0, f1, f2 = y[h], y[h + 1], y[h + 2], y[h + 3], y[h + 4], y[h + 5]
    y[f] += w1 * n2 - w2 * n1 + u1 * f2 - u2 * f1
    y[f + 1] += w2 * n0 - w0 * n2 + u2 * f0 - u0 * f2
    y[f + 2] += w0 * n1 - w1 * n0 + u0 * f1 - u1 * f0
    y[f + 3] += w1 * f2 - w2 * f1
    y[f + 4] += w2 * f0 - w0 * f2
    y[f + 5] += w0 * f1 - w1 * f0
