"""Results in words, for the tables of the terminal and of the page."""

import math

from pidtsm_studies.robustness.imperfections import Imperfection
from pidtsm_studies.robustness.results import Robustness


def tolerance_text(robustness: Robustness, imperfection: Imperfection, contender: str) -> str:
    """Up to which value, from the mildest on, every run of a contender succeeded: ``all``, the value, or ``none``."""
    values = robustness.values[imperfection.name]
    tolerated = robustness.curves[imperfection.name][contender].tolerated
    if tolerated == len(values):
        return "all"
    return f"{values[tolerated - 1]:g}" if tolerated else "none"


def measured_text(value: float) -> str:
    """A measured value with four significant digits; ``diverged`` where it is not finite."""
    return f"{value:.4g}" if math.isfinite(value) else "diverged"
