"""Results as text, for the tables of the terminal and of the page."""

import math

from pidtsm_studies.reports.labels import value_text
from pidtsm_studies.robustness.contenders import OBSERVER
from pidtsm_studies.robustness.imperfections import Imperfection
from pidtsm_studies.robustness.requirements import REQUIREMENTS
from pidtsm_studies.robustness.results import Robustness


def tolerance_text(robustness: Robustness, imperfection: Imperfection, contender: str) -> str:
    """Largest value up to which every run of a contender succeeded, from the mildest on; or ``all``, or ``none``."""
    values = robustness.values[imperfection.name]
    tolerated = robustness.curves[imperfection.name][contender].tolerated
    if tolerated == len(values):
        return "all"
    return f"{values[tolerated - 1]:g}" if tolerated else "none"


def verdict_text(robustness: Robustness) -> str:
    """In how many requirements the first contender meets all limits."""
    first = robustness.contenders[0]
    name = "The practical set" if first.name == OBSERVER.name else first.label
    return f"{name} meets all limits in {robustness.met()} of {len(REQUIREMENTS)} rows"


def measured_text(value: float) -> str:
    """A measured value; ``diverged`` if it is not finite."""
    return value_text(value) if math.isfinite(value) else "diverged"
