"""Fractional powers that several surfaces use."""

import math

from pidtsm_core.compiling.decorators import inlined


@inlined
def signed_power(x: float, exponent: float) -> float:
    """x^[a] = |x|^a sign x."""
    return math.copysign(abs(x) ** exponent, x)


@inlined
def limited_rate(e: float, de: float, exponent: float, limit: float) -> float:
    """sat(|e|^(a-1) e', limit), eqs. (13), (29); if it is not limited, the rate of e^[a] is a times this value.

    For a < 1 the expression is singular at e = 0. There the value is sign(e') limit, or 0 if e' is 0 too.
    """
    if de == 0.0:
        return 0.0
    if e == 0.0:
        return math.copysign(limit, de)
    return min(max(abs(e) ** exponent / abs(e) * de, -limit), limit)
