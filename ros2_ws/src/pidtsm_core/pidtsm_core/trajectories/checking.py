"""Whether an arm can follow a trajectory."""

import math
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.compiled import subroutine
from pidtsm_core.parameters import Array
from pidtsm_core.polynomials import add_quintic
from pidtsm_core.robots import Model, inverse_dynamics
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.extrema import DEPTH, maximum
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.motion import PiecewiseMotion

_BETWEEN_POINTS = 1.05
"""Velocities and accelerations may exceed their limits by this factor, because what a planner keeps at its points
overshoots between them."""
_OUTSIDE = 1e-6
"""A position outside by less does not matter, rad or m."""
_RATE = 250.0
"""Samples of the effort, 1/s."""
_QUANTITIES = ("position", "velocity", "acceleration")


def check(motion: PiecewiseMotion, limits: MotionLimits) -> None:
    """Check that a motion keeps the limits of position, velocity, given acceleration and effort.

    Extrema of position, velocity and acceleration are exact; efforts are those of 250 samples a second and of both ends
    of every segment. Where the motion is outside a position limit at its begin, it may only come closer. Velocities and
    accelerations may exceed their limits by 5 %. The work is done by compiled code without the GIL.

    Args:
        motion: the motion.
        limits: of the arm; a limit that is infinite is not checked, nor are efforts without a model.

    Raises:
        TrajectoryError: a limit is exceeded; the message has joint, amount, limit and time.
    """
    bounds = np.array(
        [
            [limits.lower - _OUTSIDE, limits.upper + _OUTSIDE],
            [-_BETWEEN_POINTS * limits.velocity, _BETWEEN_POINTS * limits.velocity],
            [-_BETWEEN_POINTS * limits.given_acceleration, _BETWEEN_POINTS * limits.given_acceleration],
        ]
    )
    scratch = np.empty((DEPTH + 1, 8))
    for order, quantity in enumerate(_QUANTITIES):
        worst = np.zeros(4)
        _check_derivative(motion.parameters, order, bounds[order].copy(), scratch, worst)
        if worst[0] > 0.0:
            allowed = (limits.lower, limits.upper) if order == 0 else (limits.velocity, limits.given_acceleration)
            raise TrajectoryError(_excess(limits, quantity, worst, allowed[order - 1] if order else allowed))
    if (effort := excessive_effort(motion, limits)) is not None:
        raise TrajectoryError(_excess(limits, "effort", effort, limits.effort))


def excessive_effort(motion: PiecewiseMotion, limits: MotionLimits) -> Array | None:
    """Excess (N m or N), joint, value and time (s) of the largest excess of effort, shape (4,); None: there is none."""
    if limits.model is None or np.isinf(limits.effort).all():
        return None
    # A copy, because the model has scratch space of its own, and several threads may check.
    model = limits.model._replace(parameters=limits.model.parameters.copy())
    joints, worst = len(limits.joints), np.zeros(4)
    states, efforts = np.empty((6, joints)), np.empty((1, joints))
    _check_effort(motion.parameters, model, limits.places, limits.effort, states, efforts, worst)
    return worst if worst[0] > 0.0 else None


def prepare(limits: MotionLimits) -> None:
    """Compile `check` for this arm, which takes seconds once after an installation."""
    rest = np.zeros((len(limits.joints), 8))
    rest[:, 1] = 1.0
    with suppress(TrajectoryError):
        check(PiecewiseMotion(rest), limits)


def _excess(limits: MotionLimits, quantity: str, worst: Array, allowed: Array | tuple[Array, Array]) -> str:
    """Text for the worst excess: its amount, joint, value and time."""
    joint, value = int(worst[1]), worst[2]
    unit = limits.units[joint]
    name = {
        "position": unit.position,
        "velocity": f"{unit.position}/s",
        "acceleration": f"{unit.position}/s^2",
        "effort": unit.effort,
    }[quantity]
    if isinstance(allowed, tuple):
        range_ = f"{allowed[0][joint]:.6g} to {allowed[1][joint]:.6g}"
    else:
        range_ = f"at most {allowed[joint]:.6g}"
    word = "torque" if name == "N m" else "force" if quantity == "effort" else quantity
    return f"{limits.joints[joint]}: the {word} would be {value:.6g} {name} at {worst[3]:.3f} s; {range_} is allowed"


@subroutine
def _derivative(powers: Array, order: int, duration: float, result: Array) -> None:
    """Write the derivative (order 0 to 2) of a polynomial in t / duration, as coefficients of the powers 0 to 5."""
    for i in range(6):
        result[i] = 0.0
    for i in range(6 - order):
        value = powers[i + order]
        for k in range(order):
            value *= (i + 1.0 + k) / duration
        result[i] = value


@subroutine
def _check_derivative(p: Array, order: int, bounds: Array, scratch: Array, worst: Array) -> None:
    """Write the largest excess of a derivative over bounds (lower and upper), shape (2, joints).

    `worst` gets excess, joint, value and time, and stays zero if there is none. Positions outside may come closer.
    """
    joints, n = p.shape[0], (p.shape[1] - 1) // 7
    powers, intervals = scratch[DEPTH], scratch[:DEPTH]
    for j in range(joints):
        allowed = (-bounds[0, j], bounds[1, j])
        for side in range(2):
            sign, bound = 2.0 * side - 1.0, allowed[side]
            if math.isinf(bound):
                continue
            outside = math.inf
            for k in range(n):
                start, duration = p[j, k], p[j, k + 1] - p[j, k]
                first = n + 1 + 6 * k
                _derivative(p[j, first : first + 6], order, duration, powers)
                limit = bound
                if order == 0:
                    outside = min(outside, sign * powers[0])
                    limit = max(bound, outside + _OUTSIDE)
                value, place = maximum(powers, sign, limit, intervals)
                if value - bound > worst[0] and place >= 0.0:
                    worst[0], worst[1], worst[2] = value - bound, j, sign * value
                    worst[3] = start + place * duration


@subroutine
def _check_effort(
    p: Array, model: Model, places: NDArray[np.int_], limit: Array, states: Array, efforts: Array, worst: Array
) -> None:
    """Write the largest excess of the effort to `worst`, as `_check_derivative` does.

    `states`, shape (6, joints), and `efforts`, shape (1, joints), are scratch.
    """
    joints, n = p.shape[0], (p.shape[1] - 1) // 7
    q, dq, ddq, state = states[0], states[1], states[2:3], states[3:6]
    for k in range(n):
        start, duration = p[0, k], p[0, k + 1] - p[0, k]
        first = n + 1 + 6 * k
        count = max(1, math.ceil(duration * _RATE))
        for sample in range(count + 1):
            share = sample / count
            for i in range(3):
                for j in range(joints):
                    state[i, j] = 0.0
            add_quintic(p[:, first : first + 6].T, duration, share * duration, state)
            for i in range(joints):
                q[i], dq[i], ddq[0, i] = state[0, places[i]], state[1, places[i]], state[2, places[i]]
            inverse_dynamics(model, q, dq, ddq, efforts)
            for i in range(joints):
                excess = abs(efforts[0, i]) - limit[places[i]]
                if excess > worst[0]:
                    worst[0], worst[1], worst[2] = excess, places[i], efforts[0, i]
                    worst[3] = start + share * duration
