"""The article's lumped disturbance, eq. (51)."""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.simulation.disturbances.base import Disturbance


@njit
def add(t: float, q: Array, dq: Array, p: Array, effort: Array) -> None:
    """F_d = [0.5 q1' + sin 3 q1 + 0.5 sin q1',  1.3 q2' - 1.8 sin 2 q2 + 1.1 sin q2'], as printed."""
    effort[0] += 0.5 * dq[0] + math.sin(3.0 * q[0]) + 0.5 * math.sin(dq[0])
    effort[1] += 1.3 * dq[1] - 1.8 * math.sin(2.0 * q[1]) + 1.1 * math.sin(dq[1])


ARTICLE = Disturbance(
    name="article",
    summary="the article's lumped disturbance of two joints, eq. (51)",
    parameters=(),
    joints=2,
    add=add,
)
