"""Estimators: from measured position to q, q', q''. One per file; `ESTIMATORS` contains the ones imported here."""

from pidtsm_core.estimators.base import DISTURBANCE, Estimator, Sample
from pidtsm_core.estimators.calls import estimate, estimator_address
from pidtsm_core.estimators.elastic_joints import ELASTIC_JOINT_OBSERVER
from pidtsm_core.estimators.exact import EXACT
from pidtsm_core.estimators.extended_state import EXTENDED_STATE_OBSERVER
from pidtsm_core.estimators.filtered_difference import FILTERED_DIFFERENCE
from pidtsm_core.estimators.robust_differentiator import ROBUST_DIFFERENTIATOR
from pidtsm_core.parameters.family import Family

__all__ = ["DISTURBANCE", "ESTIMATORS", "Estimator", "Sample", "estimate", "estimator_address"]

ESTIMATORS: Family[Estimator] = Family.of(Estimator, "estimators", globals(), "pidtsm_core.estimators.trial")
