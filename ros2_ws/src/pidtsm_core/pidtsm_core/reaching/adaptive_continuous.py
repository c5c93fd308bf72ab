"""Adaptive continuous reaching law of the article, eqs. (25)-(27), (30)."""

from pidtsm_core.compiled import njit
from pidtsm_core.parameters import Array, Parameter
from pidtsm_core.reaching.base import ReachingLaw
from pidtsm_core.reaching.static import sign

# State x: tau_sw, adaptive gain Y.


@njit
def switch(sigma: float, p: Array, x: Array, dt: float) -> tuple[float, float]:
    """tau_sw is a state: sigma acts on it through its derivative only, so it is continuous."""
    return x[0], x[1]


@njit
def advance(sigma: float, p: Array, x: Array, dt: float, frozen: bool) -> None:
    """Explicit Euler of tau_sw' = -k tau_sw - (Y + xi) sign(sigma) and Y' = |sigma| / kappa outside the dead zone."""
    k, kappa, xi, upsilon = p[0], p[1], p[2], p[3]
    x[0] += dt * (-k * x[0] - (x[1] + xi) * sign(sigma))
    if abs(sigma) > upsilon and not frozen:
        x[1] += dt * abs(sigma) / kappa


ADAPTIVE_CONTINUOUS = ReachingLaw(
    name="adaptive_continuous",
    summary="low-pass filtered switching with adaptive gain, eqs. (25)-(27), (30)",
    parameters=(
        Parameter("k", 1.0, "pole of the reaching law, eq. (25)", "1/s", minimum=0.0, per_joint=True),
        Parameter(
            "kappa", 0.01, "inverse adaptation rate, eq. (27)", "s^2", minimum=0.0, exclusive=True, per_joint=True
        ),
        Parameter("xi", 0.01, "margin of the switching gain, eq. (25)", minimum=0.0, per_joint=True),
        Parameter("upsilon", 0.2, "dead zone of the adaptation, eq. (30)", minimum=0.0, per_joint=True),
    ),
    switch=switch,
    advance=advance,
    prescribes_rate=False,
)
