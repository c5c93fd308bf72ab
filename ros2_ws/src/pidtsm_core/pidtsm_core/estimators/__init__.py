"""Estimators: from measured position to q, q', q''. One per file; `ESTIMATORS` contains the ones imported here."""

import numpy as np
from numba import types

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import FLOAT, NOTHING, ROW, ROWS, Interface, Pointer, lend, pointer_to
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.estimators.base import DISTURBANCE, Estimator, Sample
from pidtsm_core.estimators.exact import EXACT
from pidtsm_core.estimators.extended_state import EXTENDED_STATE_OBSERVER
from pidtsm_core.estimators.filtered_difference import FILTERED_DIFFERENCE
from pidtsm_core.estimators.robust_differentiator import ROBUST_DIFFERENTIATOR
from pidtsm_core.parameters.family import Family
from pidtsm_core.robots import Model

__all__ = ["DISTURBANCE", "ESTIMATORS", "Estimator", "Sample", "estimate", "estimator_address"]

ESTIMATORS: Family[Estimator] = Family.of(Estimator, globals())

_MODEL = pointer_to(Model(0, 0, 0, np.zeros(1)))
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
