"""Fast nonsingular terminal surface (Van 2018, the article's reference 23)."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.surfaces.base import Surface
from pidtsm_core.laws.surfaces.nonsingular_terminal import P_OVER_Q
from pidtsm_core.laws.surfaces.powers import signed_power
from pidtsm_core.parameters import Parameter


@inlined
def evaluate(e: float, de: float, integral: float, p: Array) -> tuple[float, float, float]:
    """s = e + K1 e^[lambda] + K2 (e')^[p/q]; g vanishes at e' = 0, where a law that divides by it is singular."""
    k1, k2, exponent, p_over_q = p[0], p[1], p[2], p[3]
    s = e + k1 * signed_power(e, exponent) + k2 * signed_power(de, p_over_q)
    h = de + k1 * exponent * abs(e) ** (exponent - 1.0) * de
    return s, k2 * p_over_q * abs(de) ** (p_over_q - 1.0), h


FAST_NONSINGULAR = Surface(
    name="fast_nonsingular",
    summary="e + K1 e^[lambda] + K2 (e')^[p/q]",
    # Defaults from the article's Table 1 for its comparator [23].
    parameters=(
        Parameter("k1", 3.0, "gain K1 of the power of the error", minimum=0.0, per_joint=True),
        Parameter("k2", 0.5, "gain K2 of the velocity term", minimum=0.0, exclusive=True, per_joint=True),
        Parameter("lambda", 1.5, "exponent of the error, above p/q", minimum=1.0, exclusive=True),
        P_OVER_Q,
    ),
    evaluate=evaluate,
)
