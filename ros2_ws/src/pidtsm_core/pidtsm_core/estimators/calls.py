"""How compiled code calls the estimator that was chosen."""

import numpy as np
from numba import types

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import FLOAT, NOTHING, ROW, ROWS, Interface, Pointer, lend, pointer_to
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.estimators.base import Estimator, Sample
from pidtsm_core.robots import Model

_MODEL = pointer_to(Model(0, 0, 0, 0, np.zeros(1)))
_ESTIMATE = Interface(
    NOTHING(Pointer(types.NamedTuple((ROW, ROWS, FLOAT, ROW, _MODEL, FLOAT), Sample)), ROWS, ROWS, ROWS)
)
_estimate = _ESTIMATE.call


def estimator_address(estimator: Estimator) -> int:
    """Where `estimate` finds the estimator; compiles it."""
    return _ESTIMATE.address(estimator.estimate)


@njit
def estimate(address: int, sample: Sample, p: Array, x: Array, estimates: Array) -> None:
    """Write q, q', q'': see `Estimator.estimate`; `address` is that of `estimator_address`."""
    own = Sample(sample.q, sample.truth, sample.dt, sample.effort, lend(sample.model), sample.pace)
    _estimate(address, lend(own), p, x, estimates)
