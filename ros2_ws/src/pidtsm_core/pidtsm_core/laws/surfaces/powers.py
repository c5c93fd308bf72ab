"""Fractional powers that several surfaces use."""

import math

from pidtsm_core.compiling.decorators import inlined

_ROUNDING = 1e-12
"""Smallest velocity of the error that counts, in rad/s or m/s: far above the rounding of a reference's sine or of an
estimate (1e-17 to 1e-15), far below what any sensor distinguishes from rest."""


@inlined
def signed_power(x: float, exponent: float) -> float:
    """x^[a] = |x|^a sign x."""
    return math.copysign(abs(x) ** exponent, x)


@inlined
def limited_rate(e: float, de: float, exponent: float, limit: float) -> float:
    """sat(|e|^(a-1) e', limit), eqs. (13), (29); if it is not limited, the rate of e^[a] is a times this value.

    For a < 1 the expression is singular at e = 0. There the value is sign(e') limit, or 0 if e' is 0 too. Rounding is
    not a velocity: it would give an arm at rest on its reference, or a reference that begins, the whole limit.
    """
    if abs(de) < _ROUNDING:
        return 0.0
    if e == 0.0:
        return math.copysign(limit, de)
    return min(max(abs(e) ** exponent / abs(e) * de, -limit), limit)
