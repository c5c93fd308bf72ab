"""Interface of a state estimator."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from pidtsm_core.arrays import Array
from pidtsm_core.parameters.family import Member
from pidtsm_core.robots import Model

DISTURBANCE = 2
"""Column of an estimator's state, see `Estimator.finds_disturbance`."""


class Sample(NamedTuple):
    """Inputs at a sample; the same for every estimator."""

    q: Array  # measured positions, shape (joints,), rad
    truth: Array  # true q' and q'', shape (2, joints), for estimators with `needs_truth`
    dt: float  # time since the last sample, s; 0 at the first one
    effort: Array  # commanded at the last sample, or measured (feedback.effort), shape (joints,), N m
    model: Model  # of the controller's robot
    pace: float  # how fast time passes for its bandwidths, 1 or less


@dataclass(frozen=True)
class Estimator(Member):
    """An estimator of q, q', q'' from measured positions.

    Attributes:
        estimate: compiled ``(sample, p, x, estimates)``: see `Sample`; p and x have shape (joints, SLOTS), x starts at
            zero; writes q, q', q'' to estimates, shape (3, joints).
        needs_truth: whether it needs the true derivatives, which are known only in a rollout.
        finds_disturbance: whether it writes the disturbance of each joint, the acceleration that represents what the
            model lacks (rad/s^2), to the column `DISTURBANCE` of x.
    """

    estimate: Callable[[Sample, Array, Array, Array], None]
    needs_truth: bool = False
    finds_disturbance: bool = False
