"""How compiled code calls the disturbance that was chosen."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import FLOAT, NOTHING, ROW, ROWS, Interface
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.parameters import Value
from pidtsm_core.simulation.disturbances.base import Disturbance

_ADD = Interface(NOTHING(FLOAT, ROW, ROW, ROWS, ROW))
_add = _ADD.call


class DisturbanceConfig(NamedTuple):
    """A disturbance with its parameters, as compiled code reads it."""

    add: int  # address of `Disturbance.add`
    parameters: Array  # as `Disturbance.pack` returns them


def make_disturbance(disturbance: Disturbance, values: Mapping[str, Value], joints: int) -> DisturbanceConfig:
    """The disturbance with the parameters of the group ``disturbance``, compiled."""
    packed = disturbance.pack(values, "disturbance", joints)
    return DisturbanceConfig(_ADD.address(disturbance.add), np.ascontiguousarray(packed, np.float64))


@njit
def add_disturbance(disturbance: DisturbanceConfig, t: float, q: Array, dq: Array, effort: Array) -> None:
    """Add F_d at t (s) to effort: see `Disturbance.add`."""
    _add(disturbance.add, t, q, dq, disturbance.parameters, effort)
