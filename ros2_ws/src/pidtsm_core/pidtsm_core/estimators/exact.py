"""True derivatives from the simulation, as the article assumes; no sensor delivers them."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.estimators.base import Estimator, Sample


@njit
def estimate(sample: Sample, p: Array, x: Array, estimates: Array) -> None:
    """Copy the true values; q'' is the acceleration under the torque held before the sample, 0 at the start."""
    for j in range(sample.q.size):
        estimates[0, j] = sample.q[j]
        estimates[1, j] = sample.truth[0, j]
        estimates[2, j] = sample.truth[1, j]


EXACT = Estimator(
    name="exact",
    summary="true q' and q'', in a rollout only",
    parameters=(),
    estimate=estimate,
    needs_truth=True,
)
