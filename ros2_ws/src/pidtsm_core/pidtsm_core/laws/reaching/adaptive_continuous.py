"""Adaptive continuous reaching law of the article, eqs. (25)-(27), (30), with optional bounds of the adaptation.

Eq. (27) integrates |sigma|, so any noise of sigma beyond the dead zone increases the gain permanently. Two options
counteract this: leakage (Ioannou and Kokotovic 1984, sigma modification) and projection to a bound.
"""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.reaching.base import Interval, ReachingLaw
from pidtsm_core.laws.reaching.static import sign
from pidtsm_core.parameters import Parameter
from pidtsm_core.signals import Adaptation

# State x: tau_sw, adaptive gain Y, mean of sigma during the approach to a reference.

_APPROACHING, _FROZEN = int(Adaptation.APPROACHING), int(Adaptation.FROZEN)
_MEAN = 0.05
"""s; averaging time of sigma, in which noise averages out."""


@inlined
def switch(sigma: float, p: Array, x: Array, dt: float) -> tuple[float, float]:
    """tau_sw is a state; sigma affects only its derivative, so tau_sw is continuous."""
    return x[0], x[1]


@inlined
def advance(sigma: float, p: Array, x: Array, interval: Interval) -> None:
    """Euler step: tau_sw' = -k tau_sw - (Y + xi) sign(sigma), Y' = |sigma| / kappa - leakage Y; Y <= gain_maximum.

    Y grows only outside the dead zone. It leaks everywhere, also while `frozen`, because leakage causes no windup. The
    leakage is integrated implicitly, so Y never changes its sign. If leakage, gain_maximum and layer are 0, this is the
    article's law.

    The dead zone (30) keeps the noise of sigma out of the gain. During an approach (see `Adaptation`), sigma is small
    from the start, and the gain would not adapt to the disturbances. Therefore, during an approach, the gain also grows
    within the dead zone: with the mean of sigma over _MEAN.
    """
    dt, frozen, adaptation = interval.dt, interval.frozen, interval.adaptation
    k, kappa, xi, upsilon, leakage, gain_maximum, layer = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
    if layer > 0.0:
        x[0] += dt * (-k * x[0] - (x[1] + xi) * min(max(sigma / layer, -1.0), 1.0))
    else:
        x[0] += dt * (-k * x[0] - (x[1] + xi) * sign(sigma))
    x[2] = x[2] + (sigma - x[2]) * min(dt / _MEAN, 1.0) if adaptation == _APPROACHING else 0.0
    if not frozen and adaptation != _FROZEN:
        if abs(sigma) > upsilon:
            x[1] += dt * abs(sigma) / kappa
        elif adaptation == _APPROACHING:
            x[1] += dt * abs(x[2]) / kappa
    if leakage > 0.0:
        x[1] /= 1.0 + dt * leakage
    if 0.0 < gain_maximum < x[1]:
        x[1] = gain_maximum


ADAPTIVE_CONTINUOUS = ReachingLaw(
    name="adaptive_continuous",
    summary="low-pass filtered switching with adaptive gain, eqs. (25)-(27), (30)",
    # k and kappa are from the article's Table 1. The article gives no values for xi and upsilon, and does not have the
    # other parameters.
    parameters=(
        Parameter("k", 1.0, "pole of the reaching law, eq. (25)", "1/s", minimum=0.0, per_joint=True),
        Parameter(
            "kappa", 0.01, "inverse adaptation rate, eq. (27)", "s^2", minimum=0.0, exclusive=True, per_joint=True
        ),
        Parameter("xi", 0.01, "margin of the switching gain, eq. (26)", minimum=0.0, per_joint=True),
        Parameter("upsilon", 0.2, "dead zone of the adaptation, eq. (30)", minimum=0.0, per_joint=True),
        Parameter(
            "leakage", 0.0, "rate at which the adaptive gain fades (sigma modification)", "1/s", 0.0, per_joint=True
        ),
        Parameter("gain_maximum", 0.0, "upper bound of the adaptive gain; 0: no bound", minimum=0.0, per_joint=True),
        Parameter(
            "layer",
            0.0,
            "half width of the layer in which sigma / layer replaces sign(sigma); 0: no layer, eq. (26)",
            minimum=0.0,
            per_joint=True,
        ),
    ),
    switch=switch,
    advance=advance,
    prescribes_rate=False,
)
