"""Dual terminal surface of the article, eqs. (11), (13), (29), after Ma and Sun (2018)."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.surfaces.base import Surface
from pidtsm_core.laws.surfaces.powers import limited_rate, signed_power
from pidtsm_core.parameters import Parameter


@inlined
def evaluate(e: float, de: float, integral: float, p: Array) -> tuple[float, float, float]:
    """s = e' + K1 (e^[alpha] + e^3) + K2 e, with the nonsingular u_f = sat(|e|^(alpha-1) e', u_s) in s'."""
    k1, k2, alpha, u_s = p[0], p[1], p[2], p[3]
    s = de + k1 * (signed_power(e, alpha) + e * e * e) + k2 * e
    return s, 1.0, k1 * (alpha * limited_rate(e, de, alpha, u_s) + 3.0 * e * e * de) + k2 * de


DUAL_TERMINAL = Surface(
    name="dual_terminal",
    summary="e' + K1 (e^[alpha] + e^3) + K2 e, eq. (11)",
    # Defaults from the article's Table 1; it gives no value for u_s.
    parameters=(
        Parameter("k1", 3.0, "gain K1 of the terminal and cubic terms, eq. (11)", minimum=0.0, per_joint=True),
        Parameter("k2", 0.5, "gain K2 of the linear term, eq. (11)", "1/s", minimum=0.0, per_joint=True),
        Parameter("alpha", 7 / 9, "exponent of the terminal term, eq. (11)", minimum=0.0, maximum=1.0, exclusive=True),
        Parameter("u_s", 5.0, "limit of u_f = |e|^(alpha-1) e', eq. (29)", minimum=0.0, exclusive=True),
    ),
    evaluate=evaluate,
)
