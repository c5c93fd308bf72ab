"""No disturbance."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.simulation.disturbances.base import Disturbance


@njit
def add(t: float, q: Array, dq: Array, p: Array, effort: Array) -> None:
    """Add nothing."""


NONE = Disturbance(name="none", summary="no disturbance", parameters=(), joints=0, add=add)
