"""Linear surface with the integral of the error (Slotine and Li 1991, eq. 7.7)."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.surfaces.base import Surface
from pidtsm_core.parameters import Parameter


@inlined
def evaluate(e: float, de: float, integral: float, p: Array) -> tuple[float, float, float]:
    """s = e' + K1 e + K2 int e."""
    return de + p[0] * e + p[1] * integral, 1.0, p[0] * de + p[1] * e


INTEGRAL = Surface(
    name="integral",
    summary="e' + K1 e + K2 int e; no steady-state error under a constant disturbance",
    parameters=(
        Parameter("k1", 10.0, "gain K1 of the error", "1/s", minimum=0.0, exclusive=True, per_joint=True),
        Parameter("k2", 25.0, "gain K2 of the integral of the error", "1/s^2", minimum=0.0, per_joint=True),
    ),
    evaluate=evaluate,
)
