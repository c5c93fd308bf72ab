"""Filtered difference of the measured position, the article's Remark 4."""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.estimators.base import Estimator, Sample
from pidtsm_core.parameters import Parameter

# State x: last q, last estimate of q', last estimate of q'', 1 after the first sample; then for each filter
# -cutoff * dt and its exponential, which change only with the period.


@njit
def _forget(exponent: float, x: Array, slot: int) -> float:
    """exp(exponent), cached: the exponent in x[slot], the result in x[slot + 1]."""
    if exponent != x[slot]:
        x[slot] = exponent
        x[slot + 1] = math.exp(exponent)
    return x[slot + 1]


@njit
def estimate(sample: Sample, p: Array, x: Array, estimates: Array) -> None:
    """First-order low-pass filters, discretised exactly, of the differences of q and of the resulting q'.

    The estimates start at rest: q' and q'' are 0 at the first sample.
    """
    q, dt = sample.q, sample.dt
    for j in range(q.size):
        if x[j, 3] == 1.0 and dt > 0.0:
            forget = _forget(-p[j, 0] * dt, x[j], 4)
            dq = forget * x[j, 1] + (1.0 - forget) * (q[j] - x[j, 0]) / dt
            forget = _forget(-p[j, 1] * dt, x[j], 6)
            x[j, 2] = forget * x[j, 2] + (1.0 - forget) * (dq - x[j, 1]) / dt
            x[j, 1] = dq
            if not math.isfinite(x[j, 2]):  # After an absurd position; the filters would never forget it.
                x[j, 1] = x[j, 2] = 0.0
        x[j, 0] = q[j]
        x[j, 3] = 1.0
        estimates[0, j] = q[j]
        estimates[1, j] = x[j, 1]
        estimates[2, j] = x[j, 2]


FILTERED_DIFFERENCE = Estimator(
    name="filtered_difference",
    summary="low-pass filtered differences of the measured position, Remark 4",
    # The article gives no cutoffs; docs/article.md describes the effect of these values.
    parameters=(
        Parameter(
            "velocity_cutoff", 5000.0, "cutoff of the q' filter", "rad/s", minimum=0.0, exclusive=True, per_joint=True
        ),
        Parameter(
            "acceleration_cutoff",
            1000.0,
            "cutoff of the q'' filter",
            "rad/s",
            minimum=0.0,
            exclusive=True,
            per_joint=True,
        ),
    ),
    estimate=estimate,
)
