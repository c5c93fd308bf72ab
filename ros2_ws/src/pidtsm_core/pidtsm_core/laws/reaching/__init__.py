"""Reaching laws: from sigma to the switching term. One law per file; `REACHING_LAWS` contains those imported here."""

from pidtsm_core.laws.reaching.adaptive_continuous import ADAPTIVE_CONTINUOUS
from pidtsm_core.laws.reaching.base import Interval, ReachingLaw
from pidtsm_core.laws.reaching.boundary_layer import BOUNDARY_LAYER
from pidtsm_core.laws.reaching.constant import CONSTANT
from pidtsm_core.laws.reaching.exponential import EXPONENTIAL
from pidtsm_core.laws.reaching.power_rate import POWER_RATE
from pidtsm_core.laws.reaching.super_twisting import SUPER_TWISTING
from pidtsm_core.parameters.family import Family

__all__ = ["REACHING_LAWS", "Interval", "ReachingLaw"]

REACHING_LAWS: Family[ReachingLaw] = Family.of(ReachingLaw, "reaching", globals(), "pidtsm_core.laws.reaching.trial")
