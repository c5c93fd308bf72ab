"""Estimators: from measured position to q, q', q''. One per file; `ESTIMATORS` contains the ones imported here."""

from pidtsm_core.compiled import njit
from pidtsm_core.estimators.base import DISTURBANCE, Estimator, Sample
from pidtsm_core.estimators.exact import EXACT
from pidtsm_core.estimators.extended_state import EXTENDED_STATE_OBSERVER
from pidtsm_core.estimators.filtered_difference import FILTERED_DIFFERENCE
from pidtsm_core.estimators.robust_differentiator import ROBUST_DIFFERENTIATOR
from pidtsm_core.family import Family, dispatch
from pidtsm_core.parameters import Array

__all__ = ["DISTURBANCE", "ESTIMATORS", "Estimator", "Sample", "estimate"]

ESTIMATORS: Family[Estimator] = Family.of(Estimator, globals())

_estimate = dispatch(estimator.estimate for estimator in ESTIMATORS.members)


@njit
def estimate(index: int, sample: Sample, p: Array, x: Array, estimates: Array) -> None:
    """Write q, q', q'': see `Estimator.estimate`; `index` is the estimator's place in `ESTIMATORS`."""
    _estimate(index, sample, p, x, estimates)
