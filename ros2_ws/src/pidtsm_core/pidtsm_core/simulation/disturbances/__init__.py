"""Disturbances: torques other than the motors'. One per file; `DISTURBANCES` contains the ones imported here."""

from pidtsm_core.parameters.family import Family
from pidtsm_core.simulation.disturbances.article import ARTICLE
from pidtsm_core.simulation.disturbances.base import Disturbance
from pidtsm_core.simulation.disturbances.calls import DisturbanceConfig, add_disturbance, make_disturbance
from pidtsm_core.simulation.disturbances.none import NONE

__all__ = ["DISTURBANCES", "Disturbance", "DisturbanceConfig", "add_disturbance", "make_disturbance"]

_TRIAL = "pidtsm_core.simulation.disturbances.trial"
DISTURBANCES: Family[Disturbance] = Family.of(Disturbance, "disturbances", globals(), _TRIAL)
