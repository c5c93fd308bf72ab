"""Interface of a state estimator."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from pidtsm_core.family import Member
from pidtsm_core.parameters import Array
from pidtsm_core.robots import Model


class Sample(NamedTuple):
    """Inputs at a sample; the same for every estimator."""

    q: Array  # measured positions, shape (joints,), rad
    truth: Array  # true q' and q'', shape (2, joints), for estimators with `needs_truth`
    dt: float  # time since the last sample, s; 0 at the first one
    effort: Array  # commanded at the last sample, or measured (feedback.effort), shape (joints,), N m
    model: Model  # of the controller's robot


@dataclass(frozen=True)
class Estimator(Member):
    """An estimator of q, q', q'' from measured positions.

    Attributes:
        estimate: compiled ``(sample, p, x, estimates)``: see `Sample`; p and x have shape (joints, SLOTS), x starts at
            zero; writes q, q', q'' to estimates, shape (3, joints).
        disturbance: slot of its state with the estimated disturbance of a joint, the acceleration that represents what
            the model lacks (rad/s^2); None: it estimates none.
        needs_truth: whether it needs the true derivatives, which are known only in a rollout.
    """

    estimate: Callable[[Sample, Array, Array, Array], None]
    needs_truth: bool = False
    disturbance: int | None = None
