"""Interface of a state estimator."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Value
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
            zero; writes q, q', q'' to estimates, shape (3, joints). `prepare` and `rows` change these shapes.
        needs_truth: whether it needs the true derivatives, which are known only in a rollout.
        finds_disturbance: whether it writes the disturbance of each joint, the acceleration that represents what the
            model lacks (rad/s^2), to the column `DISTURBANCE` of x.
        teaches: which of ``adaptation.*`` can learn from this disturbance, by their full names.
        poles: the disturbance is as late as one that has passed three real poles, each this many times the bandwidth.
        velocity_lags: whether the velocity lags where the disturbance changes, as that of `extended_state` does, see
            `pidtsm_core.control.lacking`.
        prepare: makes p, shape (joints, any), of the packed parameters, shape (joints, SLOTS), of the inertias of the
            rotors, and of the diagonal of the inertia matrix in the middle of the range, shape (joints,) each, kg m^2;
            None: p are the packed parameters.
        rows: how many rows x has behind those of the joints, for this number of joints; None: none.
    """

    estimate: Callable[[Sample, Array, Array, Array], None]
    needs_truth: bool = False
    finds_disturbance: bool = False
    teaches: frozenset[str] = frozenset()
    poles: float = 1.0
    velocity_lags: bool = False
    prepare: Callable[[Array, Array, Array], Array] | None = None
    rows: Callable[[int], int] | None = None

    def make_parameters(self, values: Mapping[str, Value], rotor: Array, inertia: Array) -> Array:
        """What `estimate` reads as p.

        Args:
            values: every parameter of the estimator, with the prefix ``estimator.``.
            rotor: inertias of the rotors, shape (joints,), kg m^2.
            inertia: diagonal of the inertia matrix in the middle of the range, shape (joints,), kg m^2.
        """
        packed = self.pack(values, "estimator", rotor.size)
        return packed if self.prepare is None else self.prepare(packed, rotor, inertia)
