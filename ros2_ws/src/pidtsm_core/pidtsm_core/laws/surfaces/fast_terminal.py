"""Fast terminal surface (Yu and Man 2002)."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.surfaces.base import Surface
from pidtsm_core.laws.surfaces.powers import limited_rate, signed_power
from pidtsm_core.parameters import Parameter


@inlined
def evaluate(e: float, de: float, integral: float, p: Array) -> tuple[float, float, float]:
    """s = e' + K1 e^[alpha] + K2 e; its derivative is singular at e = 0 and is limited there as in eq. (29)."""
    k1, k2, alpha, u_s = p[0], p[1], p[2], p[3]
    s = de + k1 * signed_power(e, alpha) + k2 * e
    return s, 1.0, k1 * alpha * limited_rate(e, de, alpha, u_s) + k2 * de


FAST_TERMINAL = Surface(
    name="fast_terminal",
    summary="e' + K1 e^[alpha] + K2 e; finite-time convergence, fast also far from zero",
    parameters=(
        Parameter("k1", 3.0, "gain K1 of the terminal term", minimum=0.0, exclusive=True, per_joint=True),
        Parameter("k2", 2.0, "gain K2 of the linear term", "1/s", minimum=0.0, per_joint=True),
        Parameter("alpha", 7 / 9, "exponent of the terminal term", minimum=0.0, maximum=1.0, exclusive=True),
        Parameter("u_s", 5.0, "limit of |e|^(alpha-1) e', eq. (29)", minimum=0.0, exclusive=True),
    ),
    evaluate=evaluate,
)
