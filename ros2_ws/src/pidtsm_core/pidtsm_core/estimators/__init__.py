"""Estimators: from measured position to q, q', q''. One per file; `ESTIMATORS` contains the ones imported here."""

import numpy as np
from numba import typeof, types

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.compiling.parts import FLOAT, ROW, ROWS, by_index
from pidtsm_core.compiling.pointers import Pointer, lend
from pidtsm_core.estimators.base import DISTURBANCE, Estimator, Sample
from pidtsm_core.estimators.exact import EXACT
from pidtsm_core.estimators.extended_state import EXTENDED_STATE_OBSERVER
from pidtsm_core.estimators.filtered_difference import FILTERED_DIFFERENCE
from pidtsm_core.estimators.robust_differentiator import ROBUST_DIFFERENTIATOR
from pidtsm_core.parameters.family import Family
from pidtsm_core.robots import Model

__all__ = ["DISTURBANCE", "ESTIMATORS", "Estimator", "Sample", "estimate", "estimator_index"]

ESTIMATORS: Family[Estimator] = Family.of(Estimator, globals())

_MODEL = Pointer(typeof(Model(0, 0, 0, np.zeros(1))))
_SAMPLE = types.NamedTuple((ROW, ROWS, FLOAT, ROW, _MODEL), Sample)
_estimate = by_index(
    [estimator.estimate for estimator in ESTIMATORS.members],
    types.none(Pointer(_SAMPLE), ROWS, ROWS, ROWS),
)


def estimator_index(name: str) -> int:
    """Place of the estimator in `ESTIMATORS`, for `estimate`; compiles it."""
    index = ESTIMATORS.index(name)
    _estimate.prepare(index)
    return index


@njit
def estimate(index: int, sample: Sample, p: Array, x: Array, estimates: Array) -> None:
    """Write q, q', q'': see `Estimator.estimate`; `index` is the estimator's place in `ESTIMATORS`."""
    own = Sample(sample.q, sample.truth, sample.dt, sample.effort, lend(sample.model))
    _estimate(index, lend(own), p, x, estimates)
