"""A motion that shows the parameters of an arm."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.identification.base_parameters import BaseParameters, base_parameters
from pidtsm_core.identification.regressor import described_parameters, regressor
from pidtsm_core.references.piecewise import piecewise
from pidtsm_core.robots import Description
from pidtsm_core.trajectories.checking import check
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.motion import PiecewiseMotion

HARMONICS = 5
"""Of each joint; the period repeats the first."""
_SAMPLES = 40
"""States of a period in which a motion is judged; eight for each period of the highest harmonic."""
_GUESSES, _STEPS = 40, 15
"""Random motions of which the best is improved, and steps of the improvement."""
_SHARE, _SHARE_OF_VELOCITY = 0.9, 0.6
"""Of position and effort limits, and of velocity limits; the rest is for a controller whose model is still wrong."""
_WIDEST = 2.0
"""rad or m; largest distance from the middle, also of joints that turn farther or without end."""
_QUICKEST = 4.0
"""rad/s^2 or m/s^2: largest acceleration where no limit is set; faster motion shakes what carries the arm."""
_RATE = 100.0
"""Samples of the result, 1/s."""
_SLOWER, _TRIES = 1.15, 20
"""Factor by which a motion that needs too much torque is slowed down, and how often."""


@dataclass(frozen=True)
class Excitation:
    """A periodic motion that begins and ends at rest.

    Attributes:
        joints: names.
        time: s, shape (samples,).
        motion: q, q', q'', shape (3, samples, joints), rad or m, per s, per s^2.
        condition: condition number of the weighted regressor with columns of equal length.
    """

    joints: tuple[str, ...]
    time: Array
    motion: Array
    condition: float


class _Series:
    """Fourier series of all joints, as functions of free numbers, shape (2 (harmonics - 1), joints).

    q = middle + sum of a_k sin(k w t) / (k w) - b_k cos(k w t) / (k w), after Swevers et al., IEEE Trans. Robotics and
    Automation 13 (1997). With sum a_k = 0 and sum k b_k = 0 the arm is at rest at the begin of each period. The size of
    the motion of each joint is the largest within the limits.
    """

    def __init__(self, limits: MotionLimits, period: float) -> None:
        rate = 2.0 * math.pi / period * np.arange(1, HARMONICS + 1)
        ones, rising = np.ones((1, HARMONICS)), rate[np.newaxis] / rate[0]
        # Orthonormal bases of the coefficients that leave the arm at rest.
        self._free = [np.linalg.svd(row)[2][1:].T for row in (ones, rising)]
        self._rate = rate
        half = 0.5 * (limits.upper - limits.lower)
        bounded = np.isfinite(half)
        self.middle = np.where(bounded, np.where(bounded, limits.lower, 0.0) + np.where(bounded, half, 0.0), 0.0)
        self._bounds = [
            _SHARE * np.minimum(np.where(bounded, half, np.inf), _WIDEST),
            _SHARE_OF_VELOCITY * limits.velocity,
            np.where(np.isinf(limits.given_acceleration), _QUICKEST, limits.given_acceleration),
        ]

    @property
    def free(self) -> int:
        """Free numbers of each joint."""
        return 2 * (HARMONICS - 1)

    def motion(self, numbers: Array, time: Array) -> Array:
        """q, q', q'' at these times (s) of a period, shape (3, times, joints)."""
        a, b = (basis @ half for basis, half in zip(self._free, np.split(numbers, 2), strict=True))
        dense = np.linspace(0.0, 2.0 * math.pi / self._rate[0], 4 * _SAMPLES)
        shape = self._sum(a, b, dense)
        low, high = shape[0].min(axis=0), shape[0].max(axis=0)
        largest = [0.5 * (high - low), *np.abs(shape[1:]).max(axis=1)]
        with np.errstate(divide="ignore"):
            size = np.min([bound / most for bound, most in zip(self._bounds, largest, strict=True)], axis=0)
        result = size * self._sum(a, b, time)
        result[0] += self.middle - size * 0.5 * (high + low)
        return np.asarray(result)

    def _sum(self, a: Array, b: Array, time: Array) -> Array:
        angle = np.outer(time, self._rate)
        sine, cosine, rate = np.sin(angle), np.cos(angle), self._rate[:, np.newaxis]
        return np.stack(
            [sine @ (a / rate) - cosine @ (b / rate), cosine @ a + sine @ b, -sine @ (a * rate) + cosine @ (b * rate)]
        )


def excitation(arm: Description, limits: MotionLimits, duration: float = 60.0, period: float = 10.0) -> Excitation:
    """A motion of an arm that shows its parameters.

    It minimises the condition number of the regressor, weighted with the effort limits and with columns of equal
    length, plus a penalty where the description needs more than the effort limits: the best of random Fourier series,
    then quasi-Newton. A motion that still needs too much effort is slowed down.

    Args:
        arm: its description.
        limits: of the motion, with the joints of the arm in its order. Joint limits that keep the arm from colliding
            with itself are up to the user.
        duration: s, rounded down to whole periods, of which there is at least one.
        period: s.

    Raises:
        UsageError: no motion keeps the effort limits.
    """
    base, series = base_parameters(arm.tree, len(arm.joints)), _Series(limits, period)
    described = described_parameters(arm.tree, arm.damping, arm.friction)
    weight = np.where(np.isfinite(limits.effort), limits.effort, np.median(limits.effort[np.isfinite(limits.effort)]))
    weight = np.where(np.isfinite(weight), weight, 1.0)
    time = np.linspace(0.0, period, _SAMPLES, endpoint=False)

    def cost(numbers: Array) -> float:
        matrix = regressor(arm.tree, *series.motion(numbers.reshape(-1, len(arm.joints)), time))
        excess = np.abs(matrix @ described) / (_SHARE * limits.effort) - 1.0
        return math.log(_condition(matrix, base, weight)) + 10.0 * float(np.sum(np.maximum(excess, 0.0)))

    random = np.random.default_rng(0)
    guesses = random.normal(size=(_GUESSES, series.free * len(arm.joints)))
    # The matrices are small: several threads of BLAS wait for each other, on a busy machine 20 times as long.
    with threadpool_limits(limits=1, user_api="blas"):
        best = min(guesses, key=cost)
        best = minimize(cost, best, method="L-BFGS-B", options={"maxiter": _STEPS, "maxfun": 10**6}).x
    numbers = best.reshape(-1, len(arm.joints))
    count = max(1, int(duration / period + 1e-9))
    for slower in _SLOWER ** np.arange(_TRIES):
        found = _sampled(arm, series, numbers, period, slower)
        if _fits(found, limits):
            matrix = regressor(arm.tree, *found.motion)
            whole = [np.tile(each[:-1], (count, 1)) for each in found.motion]
            motion = np.stack([np.vstack([w, e[-1:]]) for w, e in zip(whole, found.motion, strict=True)])
            times = np.arange(motion.shape[1]) * (found.time[1] - found.time[0])
            return Excitation(arm.joints, times, motion, _condition(matrix, base, weight))
    raise UsageError("no motion keeps the effort limits: even the arm at rest needs nearly all its torque")


def _sampled(arm: Description, series: _Series, numbers: Array, period: float, slower: float) -> Excitation:
    """One period, slowed down by a factor, with both ends."""
    count = round(period * _RATE)
    time = np.linspace(0.0, period, count + 1)
    motion = series.motion(numbers, time)
    motion[1] /= slower
    motion[2] /= slower**2
    motion[1:, [0, -1]] = motion[1:, [0, -1]] * 0.0
    return Excitation(arm.joints, slower * time, motion, math.inf)


def _fits(found: Excitation, limits: MotionLimits) -> bool:
    """Whether a motion keeps the limits between its samples too."""
    knots = found.motion.swapaxes(0, 1)
    try:
        check(PiecewiseMotion(piecewise(found.time, knots[:-1], knots[1:])), limits)
    except TrajectoryError:
        return False
    return True


def _condition(matrix: Array, base: BaseParameters, weight: Array) -> float:
    """Condition number of the base regressor, weighted by 1 / weight, with columns of equal length."""
    columns = (matrix[..., base.columns] / weight[:, np.newaxis]).reshape(-1, base.columns.size)
    size = np.linalg.norm(columns, axis=0)
    gram = (columns / np.where(size > 0.0, size, 1.0)).T @ (columns / np.where(size > 0.0, size, 1.0))
    values = np.linalg.eigvalsh(gram)
    return float(np.sqrt(values[-1] / max(values[0], 1e-18)))
