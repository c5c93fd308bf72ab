"""Super-twisting (Levant 1993), discretised by implicit Euler, without the chattering of explicit discretisation.

Brogliato, Polyakov and Efimov, "The implicit discretization of the super-twisting sliding-mode control
algorithm", IEEE Transactions on Automatic Control 65(8), 2020.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.reaching.base import Interval, ReachingLaw
from pidtsm_core.parameters import Parameter

# State x: v.


@inlined
def _implicit(sigma: float, p: Array, v: float, dt: float) -> tuple[float, float]:
    """(|z|^(1/2) sign z, selection of sign z), where z is the undisturbed sigma one period later.

    z solves z + dt gain |z|^(1/2) sign z + dt^2 integral_gain sign z = sigma + dt v.
    """
    free = sigma + dt * v
    jump = dt * dt * p[1]
    if abs(free) <= jump:
        return 0.0, free / jump if jump > 0.0 else 0.0
    half = 0.5 * dt * p[0]
    root = math.sqrt(half * half + abs(free) - jump) - half
    return math.copysign(root, free), math.copysign(1.0, free)


@inlined
def switch(sigma: float, p: Array, x: Array, dt: float) -> tuple[float, float]:
    """-gain |z|^(1/2) sign z + v at the end of the period."""
    root, selection = _implicit(sigma, p, x[0], dt)
    return -p[0] * root + x[0] - dt * p[1] * selection, p[0]


@inlined
def advance(sigma: float, p: Array, x: Array, interval: Interval) -> None:
    """v' = -integral_gain sign z."""
    if not interval.frozen:
        _, selection = _implicit(sigma, p, x[0], interval.dt)
        x[0] -= interval.dt * p[1] * selection


SUPER_TWISTING = ReachingLaw(
    name="super_twisting",
    summary="continuous second-order sliding mode, implicit Euler",
    parameters=(
        Parameter("gain", 5.0, "gain of |sigma|^(1/2)", minimum=0.0, per_joint=True),
        Parameter("integral_gain", 5.0, "gain of the integrated sign", minimum=0.0, per_joint=True),
    ),
    switch=switch,
    advance=advance,
)
