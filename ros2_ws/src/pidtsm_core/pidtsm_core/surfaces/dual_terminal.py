"""Dual terminal surface of the article, eqs. (11), (13), (29), after Ma and Sun (2018)."""

import math

from pidtsm_core.compiled import njit
from pidtsm_core.parameters import Array, Parameter
from pidtsm_core.surfaces.base import Surface


@njit
def evaluate(e: float, de: float, integral: float, p: Array) -> tuple[float, float, float]:
    """s = e' + K1 (e^[alpha] + e^3) + K2 e with the nonsingular u_f = sat(|e|^(alpha-1) e', u_s) in s'.

    At e = 0, u_f is the limit sign(e') u_s (0 where e' is 0 too).
    """
    k1, k2, alpha, u_s = p[0], p[1], p[2], p[3]
    magnitude = abs(e)
    power = magnitude**alpha
    s = de + k1 * (math.copysign(power, e) + e * e * e) + k2 * e
    if de == 0.0:
        u_f = 0.0
    elif magnitude == 0.0:
        u_f = math.copysign(u_s, de)
    else:
        u_f = min(max(power / magnitude * de, -u_s), u_s)
    return s, 1.0, k1 * (alpha * u_f + 3.0 * e * e * de) + k2 * de


DUAL_TERMINAL = Surface(
    name="dual_terminal",
    summary="e' + K1 (e^[alpha] + e^3) + K2 e, eq. (11)",
    parameters=(
        Parameter("k1", 3.0, "gain K1 of the terminal and cubic terms, eq. (11)", minimum=0.0, per_joint=True),
        Parameter("k2", 0.5, "gain K2 of the linear term, eq. (11)", "1/s", minimum=0.0, per_joint=True),
        Parameter("alpha", 7 / 9, "exponent of the terminal term, eq. (11)", minimum=0.0, maximum=1.0, exclusive=True),
        Parameter("u_s", 5.0, "limit of u_f = |e|^(alpha-1) e', eq. (29)", minimum=0.0, exclusive=True),
    ),
    evaluate=evaluate,
)
