"""What a state estimator gets and provides."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from pidtsm_core.family import Member
from pidtsm_core.parameters import Array


class Sample(NamedTuple):
    """What is known at a sample; the same for every estimator."""

    q: Array  # measured positions, shape (joints,), rad
    truth: Array  # true q' and q'', shape (2, joints), for an estimator that `needs_truth`
    dt: float  # time since the last sample, s; 0 at the first
    effort: Array  # commanded at the last sample, shape (joints,), N m
    robot: int  # place of the controller's robot in `ROBOTS`
    model: Array  # and its parameters, shape (model parameters,)


@dataclass(frozen=True)
class Estimator(Member):
    """Measured positions to estimates of q, q', q''.

    Attributes:
        estimate: compiled ``(sample, p, x, estimates)``: see `Sample`; p and x of shape (joints, SLOTS), x zero at the
            start; writes q, q', q'' to estimates, shape (3, joints).
        needs_truth: works in a rollout only, where the true derivatives are known.
    """

    estimate: Callable[[Sample, Array, Array, Array], None]
    needs_truth: bool = False
