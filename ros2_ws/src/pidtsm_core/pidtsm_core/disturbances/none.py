"""No disturbance."""

from pidtsm_core.compiled import njit
from pidtsm_core.disturbances.base import Disturbance
from pidtsm_core.parameters import Array


@njit
def add(q: Array, dq: Array, effort: Array) -> None:
    """Add nothing."""


NONE = Disturbance(name="none", summary="no disturbance", parameters=(), joints=0, add=add)
