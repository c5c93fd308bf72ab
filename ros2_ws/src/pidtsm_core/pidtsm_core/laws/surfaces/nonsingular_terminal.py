"""Nonsingular terminal surface (Feng, Yu and Man 2002)."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.surfaces.base import Surface
from pidtsm_core.laws.surfaces.powers import signed_power
from pidtsm_core.parameters import Parameter


@inlined
def evaluate(e: float, de: float, integral: float, p: Array) -> tuple[float, float, float]:
    """s = e + K2 (e')^[p/q]; g vanishes at e' = 0."""
    k2, p_over_q = p[0], p[1]
    return e + k2 * signed_power(de, p_over_q), k2 * p_over_q * abs(de) ** (p_over_q - 1.0), de


# Default from the article's Table 1 for its comparator [23].
P_OVER_Q = Parameter("p_over_q", 9 / 7, "exponent p/q of the velocity error", minimum=1.0, maximum=2.0, exclusive=True)

NONSINGULAR_TERMINAL = Surface(
    name="nonsingular_terminal",
    summary="e + K2 (e')^[p/q]; finite-time convergence",
    parameters=(
        Parameter("k2", 0.5, "gain K2 of the velocity term", minimum=0.0, exclusive=True, per_joint=True),
        P_OVER_Q,
    ),
    evaluate=evaluate,
)
