"""Saturation in a boundary layer instead of the sign (Slotine and Sastry 1983)."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.reaching.base import ReachingLaw
from pidtsm_core.parameters import Parameter


@inlined
def switch(sigma: float, p: Array, x: Array, dt: float) -> tuple[float, float]:
    """-gain sat(sigma / width)."""
    return -p[0] * min(max(sigma / p[1], -1.0), 1.0), p[0]


BOUNDARY_LAYER = ReachingLaw(
    name="boundary_layer",
    summary="-gain sat(sigma / width)",
    parameters=(
        Parameter("gain", 5.0, "switching gain", "unit of sigma / s", minimum=0.0, per_joint=True),
        Parameter(
            "width",
            0.1,
            "half width of the boundary layer",
            "unit of sigma",
            minimum=0.0,
            exclusive=True,
            per_joint=True,
        ),
    ),
    switch=switch,
)
