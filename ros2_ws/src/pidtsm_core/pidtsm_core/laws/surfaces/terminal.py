"""Terminal surface (Man, Paplinski and Wu 1994)."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.surfaces.base import Surface
from pidtsm_core.laws.surfaces.powers import limited_rate, signed_power
from pidtsm_core.parameters import Parameter


@inlined
def evaluate(e: float, de: float, integral: float, p: Array) -> tuple[float, float, float]:
    """s = e' + K1 e^[alpha]; its derivative is singular at e = 0 and is limited there as in eq. (29)."""
    k1, alpha, u_s = p[0], p[1], p[2]
    return de + k1 * signed_power(e, alpha), 1.0, k1 * alpha * limited_rate(e, de, alpha, u_s)


TERMINAL = Surface(
    name="terminal",
    summary="e' + K1 e^[alpha]; finite-time convergence",
    parameters=(
        Parameter("k1", 3.0, "gain K1 of the terminal term", minimum=0.0, exclusive=True, per_joint=True),
        Parameter("alpha", 7 / 9, "exponent of the terminal term", minimum=0.0, maximum=1.0, exclusive=True),
        Parameter("u_s", 5.0, "limit of |e|^(alpha-1) e', eq. (29)", minimum=0.0, exclusive=True),
    ),
    evaluate=evaluate,
)
