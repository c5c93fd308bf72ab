"""Linear surface (Utkin; Slotine and Li 1991, eq. 7.5)."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.surfaces.base import Surface
from pidtsm_core.parameters import Parameter


@inlined
def evaluate(e: float, de: float, integral: float, p: Array) -> tuple[float, float, float]:
    """s = e' + K1 e."""
    return de + p[0] * e, 1.0, p[0] * de


LINEAR = Surface(
    name="linear",
    summary="e' + K1 e; exponential convergence",
    parameters=(Parameter("k1", 10.0, "gain K1 of the error", "1/s", minimum=0.0, exclusive=True, per_joint=True),),
    evaluate=evaluate,
)
