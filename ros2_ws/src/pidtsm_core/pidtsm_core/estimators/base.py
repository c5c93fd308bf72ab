"""What a state estimator provides."""

from collections.abc import Callable
from dataclasses import dataclass

from pidtsm_core.family import Member
from pidtsm_core.parameters import Array


@dataclass(frozen=True)
class Estimator(Member):
    """Measured positions to estimates of q, q', q''.

    Attributes:
        estimate: compiled ``(q, truth, dt, effort, robot, model, p, x, estimates)``: q in rad, shape (joints,); truth
            the true q' and q'', shape (2, joints); dt in s since the last sample, 0 at the first; effort commanded at
            the last sample, N m, shape (joints,); robot the place of the controller's robot in `ROBOTS` and model its
            parameters; p and x of shape (joints, SLOTS), x zero at the start; writes q, q', q'' to estimates, shape
            (3, joints).
        needs_truth: works in a rollout only, where the true derivatives are known.
    """

    estimate: Callable[[Array, Array, float, Array, int, Array, Array, Array, Array], None]
    needs_truth: bool = False
