"""Sliding surfaces: from errors to s, g and h. One surface per file; `SURFACES` contains the ones imported here."""

from numba.core.types.containers import UniTuple

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.compiling.parts import FLOAT, ROW, by_index
from pidtsm_core.laws.surfaces.base import Surface
from pidtsm_core.laws.surfaces.dual_terminal import DUAL_TERMINAL
from pidtsm_core.laws.surfaces.fast_nonsingular import FAST_NONSINGULAR
from pidtsm_core.laws.surfaces.fast_terminal import FAST_TERMINAL
from pidtsm_core.laws.surfaces.integral import INTEGRAL
from pidtsm_core.laws.surfaces.linear import LINEAR
from pidtsm_core.laws.surfaces.nonsingular_terminal import NONSINGULAR_TERMINAL
from pidtsm_core.laws.surfaces.terminal import TERMINAL
from pidtsm_core.parameters.family import Family

__all__ = ["SURFACES", "Surface", "evaluate_surface"]

SURFACES: Family[Surface] = Family.of(Surface, globals())

_evaluate = by_index(
    [surface.evaluate for surface in SURFACES.members],
    UniTuple(FLOAT, 3)(FLOAT, FLOAT, FLOAT, ROW),
)


@njit
def evaluate_surface(index: int, e: float, de: float, integral: float, p: Array) -> tuple[float, float, float]:
    """(s, g, h) of a surface on its own: see `Surface.evaluate`; `index` is its place in `SURFACES`."""
    return _evaluate(index, e, de, integral, p)
