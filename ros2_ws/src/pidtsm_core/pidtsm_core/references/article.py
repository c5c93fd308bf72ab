"""The article's reference, eq. (52)."""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.references.base import Reference


@njit
def evaluate(t: float, p: Array, desired: Array) -> None:
    """q_d = [a + b, b - a] with a = 0.2 cos 0.7t, b = 0.2 cos(0.5t - 0.2), and its derivatives."""
    a0 = 0.2 * math.cos(0.7 * t)
    a1 = -0.2 * 0.7 * math.sin(0.7 * t)
    a2 = -0.7 * 0.7 * a0
    b0 = 0.2 * math.cos(0.5 * t - 0.2)
    b1 = -0.2 * 0.5 * math.sin(0.5 * t - 0.2)
    b2 = -0.5 * 0.5 * b0
    desired[0, 0] = a0 + b0
    desired[0, 1] = b0 - a0
    desired[1, 0] = a1 + b1
    desired[1, 1] = b1 - a1
    desired[2, 0] = a2 + b2
    desired[2, 1] = b2 - a2


ARTICLE = Reference(
    name="article",
    summary="two-joint sum of cosines, eq. (52)",
    parameters=(),
    joints=2,
    evaluate=evaluate,
)
