"""Fractional powers that the surfaces share."""

import math

from pidtsm_core.compiled import njit


@njit
def signed_power(x: float, exponent: float) -> float:
    """x^[a] = |x|^a sign x."""
    return math.copysign(abs(x) ** exponent, x)


@njit
def limited_rate(e: float, de: float, exponent: float, limit: float) -> float:
    """sat(|e|^(a-1) e', limit), eqs. (13), (29): the rate of e^[a] is a times this, where it is not limited.

    For a < 1 it is singular at e = 0, where it takes its limit sign(e') limit (0 where e' is 0 too).
    """
    if de == 0.0:
        return 0.0
    if e == 0.0:
        return math.copysign(limit, de)
    return min(max(abs(e) ** exponent / abs(e) * de, -limit), limit)
