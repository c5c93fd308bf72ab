"""Disturbances: torques other than the motors'. One per file; `DISTURBANCES` contains the ones imported here."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.parameters.family import Family, dispatch
from pidtsm_core.simulation.disturbances.article import ARTICLE
from pidtsm_core.simulation.disturbances.base import Disturbance
from pidtsm_core.simulation.disturbances.none import NONE

__all__ = ["DISTURBANCES", "Disturbance", "add_disturbance"]

DISTURBANCES: Family[Disturbance] = Family.of(Disturbance, globals())

_add = dispatch(disturbance.add for disturbance in DISTURBANCES.members)


@njit
def add_disturbance(index: int, q: Array, dq: Array, effort: Array) -> None:
    """Add F_d to effort: see `Disturbance.add`; `index` is the disturbance's place in `DISTURBANCES`."""
    _add(index, q, dq, effort)
