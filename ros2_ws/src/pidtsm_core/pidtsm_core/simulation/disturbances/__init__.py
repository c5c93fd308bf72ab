"""Disturbances: torques other than the motors'. One per file; `DISTURBANCES` contains the ones imported here."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import NOTHING, ROW, Interface
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.parameters.family import Family
from pidtsm_core.simulation.disturbances.article import ARTICLE
from pidtsm_core.simulation.disturbances.base import Disturbance
from pidtsm_core.simulation.disturbances.none import NONE

__all__ = ["DISTURBANCES", "Disturbance", "add_disturbance", "disturbance_address"]

DISTURBANCES: Family[Disturbance] = Family.of(Disturbance, globals())

_ADD = Interface(NOTHING(ROW, ROW, ROW))
_add = _ADD.call


def disturbance_address(disturbance: Disturbance) -> int:
    """Where `add_disturbance` finds the disturbance; compiles it."""
    return _ADD.address(disturbance.add)


@njit
def add_disturbance(address: int, q: Array, dq: Array, effort: Array) -> None:
    """Add F_d to effort: see `Disturbance.add`; `address` is that of `disturbance_address`."""
    _add(address, q, dq, effort)
