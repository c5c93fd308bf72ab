"""What explains how an arm answers when its joints are shaken: springs, rotors, and lateness of its drives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.elastic_joints import Answer, Believed, Equations, Side, Unknowns

_STIFFER, _LINKS, _ROTORS, _ANY_ROTOR = 0.5, 0.25, 0.3, 1.2
"""Standard deviations of logarithms: stiffness per effort limit from joint to joint, what is described of links and of
rotors, and rotors of which nothing is described."""
_QUICK = 300.0
"""rad/s^2; the acceleration of a rotor alone at the effort limit where nothing is described."""
_STIFF, _VARIES = 100.0, 1.5
"""1/rad; usual stiffness per effort limit, and standard deviation of its logarithm between arms."""
_RELAXATION, _RELAXES = 0.001, 1.0
"""s; usual ratio of damping and stiffness, and standard deviation of its logarithm."""
_RESPONSE, _RESPONDS = 1500.0, 1.5
"""rad/s; usual bandwidth of the drives, of second order, and standard deviation of its logarithm."""
_DELAY, _DELAYED = 0.003, 0.003
"""s; usual delay, and its standard deviation."""
_WEIGHT = 3.0
"""How much all that counts relative to one equation."""
_FREQUENCIES = (15.0, 60.0)
"""Hz; the first guesses of the resonances of rotors on their springs."""
_TRIES, _STEPS, _WEIGHINGS = 2, 40, 3
"""First guesses, steps of the solver, and how often the equations are weighed again, of each way to explain them."""
_MORE = 3
"""More first guesses of the way that explains them best."""
_FARTHEST = 3.0
"""Bound of the logarithms of the factors of the links."""
_NORMAL = 1.96


@dataclass(frozen=True)
class Explanation:
    """What explains the answers, each array of shape (joints,); of joints that were not shaken, 0.

    Attributes:
        side: where the encoders are.
        rotor: kg m^2.
        stiffness: N m/rad; 0: rigid.
        damping: N m s/rad.
        relaxation: damping over stiffness, the same for all joints, s.
        uncertainty: of the logarithms of `rotor` and `stiffness`, half the interval of 95 %, shape (2, joints).
        delay: with which torques act, including the lag of the drives, but not the time for which they are held, s.
        cost: how badly the answers are explained.
        rate: frequencies of the answers, shape (answers,), rad/s.
        joint: the joint shaken in each of them, likewise.
        measured, explained: acceleration per torque, likewise, 1/(kg m^2).
    """

    side: Side
    rotor: Array
    stiffness: Array
    damping: Array
    relaxation: float
    uncertainty: Array
    delay: float
    cost: float
    rate: Array
    joint: NDArray[np.int64]
    measured: Array
    explained: Array


def explain(answers: Sequence[Answer], believed: Believed) -> dict[Side, Explanation]:
    """The best explanation with encoders at the motors, with encoders at the links, and without springs.

    Args:
        answers: of all joints whose springs are sought.
        believed: what is known beforehand.
    """
    random = np.random.default_rng(1)
    problems = {side: _Problem(answers, believed, side) for side in Side}
    found = {side: min((each.solved(random) for _ in range(_TRIES)), key=_cost) for side, each in problems.items()}
    best = min(found, key=lambda side: found[side].cost)
    if best is not Side.RIGID:
        more = (problems[best].solved(random) for _ in range(_MORE))
        found[best] = min((found[best], *more), key=_cost)
    return found


def _robust(left: Array) -> Array:
    """Cost of what is left unexplained, in standard deviations: half its square, but linear if it is much."""
    return np.asarray(np.sqrt(1.0 + left**2) - 1.0)


def _cost(explanation: Explanation) -> float:
    return explanation.cost


class _Problem:
    """Equations, and what is believed, as one problem of least squares."""

    def __init__(self, answers: Sequence[Answer], believed: Believed, side: Side) -> None:
        self._believed, self._equations = believed, Equations(answers, believed, side)
        self._scale = np.ones(self._equations.joint.size)

    def solved(self, random: np.random.Generator) -> Explanation:
        """The explanation from a random first guess."""
        vector, bounds = self._guess(random), self._bounds()
        size = np.concatenate(self._sizes())
        for _ in range(_WEIGHINGS):
            self._scale = self._weighed(vector)
            found = least_squares(
                self._residuals, vector, jac=self._slopes, bounds=bounds, x_scale=size, max_nfev=_STEPS
            )
            vector = np.clip(found.x, *bounds)
        covariance = np.linalg.pinv(found.jac.T @ found.jac)
        left, beliefs = self._left(vector), self._beliefs(vector)
        half = _NORMAL * max(1.0, float(np.sqrt(np.mean(left**2)))) * np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return self._explanation(vector, half, float(np.sum(_robust(left)) + 0.5 * np.sum(beliefs**2)))

    def _explanation(self, vector: Array, half: Array, cost: float) -> Explanation:
        equations = self._equations
        unknowns, halves = equations.unknowns(vector), equations.unknowns(half)
        springs, whole = equations.side is not Side.RIGID, equations.all_joints
        stiffness = np.exp(unknowns.stiffness) if springs else np.zeros(equations.shaken.size)
        relaxation = float(np.exp(unknowns.relaxation[0]))
        own = equations.position[np.arange(equations.joint.size), equations.joint]
        moved = np.abs(equations.s**2 * own)
        return Explanation(
            side=equations.side,
            rotor=whole(np.exp(unknowns.rotor)),
            stiffness=whole(stiffness),
            damping=whole(relaxation * stiffness),
            relaxation=relaxation,
            uncertainty=np.stack([whole(halves.rotor), whole(halves.stiffness if springs else 0.0 * halves.stiffness)]),
            delay=float(unknowns.delay[0] + np.sqrt(2.0) / np.exp(unknowns.response[0])),
            cost=cost,
            rate=np.abs(equations.s),
            joint=equations.joint,
            measured=moved / np.abs(equations.effort),
            explained=moved * np.abs(equations.late(unknowns)) / np.abs(equations.torque(unknowns)),
        )

    def _guess(self, random: np.random.Generator) -> Array:
        believed, count = self._believed, self._equations.shaken.size
        unknown = believed.effort / _QUICK * np.exp(random.uniform(-1.0, 1.0, believed.effort.size))
        rotor = np.where(believed.rotor > 0.0, believed.rotor, unknown)[self._equations.shaken]
        stiffness = rotor * (2.0 * np.pi * random.uniform(*_FREQUENCIES, count)) ** 2
        usual = np.log(stiffness / believed.effort[self._equations.shaken]).mean()
        guess = Unknowns(
            np.log(rotor),
            np.log(stiffness),
            np.zeros(count),
            np.zeros(count),
            np.zeros(count),
            np.array([usual]),
            np.array([_DELAY]),
            np.log([_RELAXATION]),
            np.log([_RESPONSE]),
        )
        return np.clip(np.concatenate(guess), *self._bounds())

    def _bounds(self) -> tuple[Array, Array]:
        count, limit = self._equations.shaken.size, np.log(self._believed.effort[self._equations.shaken])
        ones = np.ones(count)
        low = Unknowns(
            limit + np.log(1e-6),
            limit + np.log(3.0),
            -np.inf * ones,
            -np.inf * ones,
            -_FARTHEST * ones,
            np.array([0.0]),
            np.array([0.0]),
            np.log([1e-5]),
            np.log([200.0]),
        )
        high = Unknowns(
            limit + np.log(1.0),
            limit + np.log(3e3),
            np.inf * ones,
            np.inf * ones,
            _FARTHEST * ones,
            np.array([10.0]),
            np.array([0.05]),
            np.log([0.02]),
            np.log([5000.0]),
        )
        return np.concatenate(low), np.concatenate(high)

    def _sizes(self) -> Unknowns:
        ones = np.ones(self._equations.shaken.size)
        moved = self._believed.effort[self._equations.shaken] / _QUICK
        one = np.ones(1)
        return Unknowns(ones, ones, 10.0 * moved, 10.0 * moved, 0.3 * ones, one, 0.001 * one, one, one)

    def _left(self, vector: Array) -> Array:
        """What each equation leaves unexplained, in standard deviations, shape (answers,)."""
        equations, unknowns = self._equations, self._equations.unknowns(vector)
        left = equations.torque(unknowns) - equations.effort * equations.late(unknowns)
        return np.asarray(np.abs(left) / equations.error(unknowns))

    def _weighed(self, vector: Array) -> Array:
        """By what each equation is divided: the error that it may have, more where more is left, (answers,), N m."""
        left = self._left(vector)
        more = np.sqrt(0.5 * left**2 / np.maximum(_robust(left), 1e-12))
        return np.asarray(self._equations.error(self._equations.unknowns(vector)) * more)

    def _beliefs(self, vector: Array) -> Array:
        """How far what is sought is from what is believed, in weighted standard deviations."""
        unknowns, believed, shaken = self._equations.unknowns(vector), self._believed, self._equations.shaken
        described = believed.rotor[shaken] > 0.0
        rotor = np.where(described, believed.rotor[shaken], believed.effort[shaken] / _QUICK)
        apart = [
            (unknowns.rotor - np.log(rotor)) / np.where(described, _ROTORS, _ANY_ROTOR),
            (unknowns.stiffness - np.log(believed.effort[shaken]) - unknowns.usual) / _STIFFER,
            unknowns.links / _LINKS,
            (unknowns.usual - np.log(_STIFF)) / _VARIES,
            (unknowns.delay - _DELAY) / _DELAYED,
            (unknowns.relaxation - np.log(_RELAXATION)) / _RELAXES,
            (unknowns.response - np.log(_RESPONSE)) / _RESPONDS,
        ]
        return _WEIGHT * np.concatenate(apart)

    def _residuals(self, vector: Array) -> Array:
        """In standard deviations: of the equations, then of what is believed."""
        equations, unknowns = self._equations, self._equations.unknowns(vector)
        left = (equations.torque(unknowns) - equations.effort * equations.late(unknowns)) / self._scale
        return np.concatenate([left.real, left.imag, self._beliefs(vector)])

    def _slopes(self, vector: Array) -> Array:
        """Derivatives of `_residuals`."""
        of_equations = self._equations.slopes(self._equations.unknowns(vector)) / self._scale[:, np.newaxis]
        # Beliefs are linear.
        none = np.zeros(vector.size)
        of_beliefs = np.stack([self._beliefs(each) for each in np.eye(vector.size)], axis=1)
        of_beliefs -= self._beliefs(none)[:, np.newaxis]
        return np.concatenate([of_equations.real, of_equations.imag, of_beliefs])
