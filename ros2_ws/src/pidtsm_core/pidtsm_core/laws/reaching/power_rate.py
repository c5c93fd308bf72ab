"""Power rate reaching law (Gao and Hung 1993)."""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.reaching.base import ReachingLaw
from pidtsm_core.parameters import Parameter


@inlined
def switch(sigma: float, p: Array, x: Array, dt: float) -> tuple[float, float]:
    """-gain |sigma|^exponent sign(sigma)."""
    return -p[0] * math.copysign(abs(sigma) ** p[1], sigma), p[0]


POWER_RATE = ReachingLaw(
    name="power_rate",
    summary="-gain |sigma|^exponent sign(sigma)",
    parameters=(
        Parameter("gain", 5.0, "switching gain", minimum=0.0, per_joint=True),
        Parameter("exponent", 0.5, "exponent of |sigma|", minimum=0.0, maximum=1.0, exclusive=True),
    ),
    switch=switch,
)
