"""Sliding surfaces: from errors to s, g and h. One surface per file; `SURFACES` contains the ones imported here."""

from pidtsm_core.laws.surfaces.base import Surface
from pidtsm_core.laws.surfaces.dual_terminal import DUAL_TERMINAL
from pidtsm_core.laws.surfaces.fast_nonsingular import FAST_NONSINGULAR
from pidtsm_core.laws.surfaces.fast_terminal import FAST_TERMINAL
from pidtsm_core.laws.surfaces.integral import INTEGRAL
from pidtsm_core.laws.surfaces.linear import LINEAR
from pidtsm_core.laws.surfaces.nonsingular_terminal import NONSINGULAR_TERMINAL
from pidtsm_core.laws.surfaces.terminal import TERMINAL
from pidtsm_core.parameters.family import Family

__all__ = ["SURFACES", "Surface"]

SURFACES: Family[Surface] = Family.of(Surface, "surfaces", globals(), "pidtsm_core.laws.surfaces.trial")
