"""Constant rate reaching law (Gao and Hung 1993)."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.reaching.base import ReachingLaw
from pidtsm_core.laws.reaching.static import sign
from pidtsm_core.parameters import Parameter


@inlined
def switch(sigma: float, p: Array, x: Array, dt: float) -> tuple[float, float]:
    """-gain sign(sigma)."""
    return -p[0] * sign(sigma), p[0]


CONSTANT = ReachingLaw(
    name="constant",
    summary="-gain sign(sigma)",
    parameters=(Parameter("gain", 2.0, "switching gain", "unit of sigma / s", minimum=0.0, per_joint=True),),
    switch=switch,
)
