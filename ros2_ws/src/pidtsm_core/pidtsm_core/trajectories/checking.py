"""Whether an arm can follow a trajectory."""

import math
from contextlib import suppress

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import subroutine
from pidtsm_core.trajectories.effort_bound import largest_excess
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.extrema import DEPTH, maximum
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.margins import PLANNED_SHARE
from pidtsm_core.trajectories.motion import PiecewiseMotion

_BETWEEN_POINTS = 1.05
"""Accelerations may exceed their limits by this factor, because what a planner keeps at its points overshoots between
them. Velocities may not, because the controller stops beyond their limit."""
_OUTSIDE = 1e-6
"""A position outside by less does not matter, rad or m."""
_ROUNDING = 1.0 + 1e-9
_QUANTITIES = ("position", "velocity", "acceleration")


def check(motion: PiecewiseMotion, limits: MotionLimits) -> None:
    """Check that a motion keeps the limits of position, velocity, given acceleration and effort.

    Extrema of position, velocity and acceleration are exact. No effort exceeds its limit by more than 1 %, at any
    moment (see `effort_bound`). Where the motion is outside a position limit at its begin, it may only come closer.
    Velocities must keep `MotionLimits.planned_velocity`; accelerations may exceed their limits by 5 %. The work is done
    by compiled code without the GIL.

    Args:
        motion: the motion.
        limits: of the arm; a limit that is infinite is not checked, nor are efforts without a model.

    Raises:
        TrajectoryError: a limit is exceeded; the message has joint, amount, limit and time.
    """
    bounds = np.array(
        [
            [limits.lower - _OUTSIDE, limits.upper + _OUTSIDE],
            [-_ROUNDING * limits.planned_velocity, _ROUNDING * limits.planned_velocity],
            [-_BETWEEN_POINTS * limits.given_acceleration, _BETWEEN_POINTS * limits.given_acceleration],
        ]
    )
    scratch = np.empty((DEPTH + 1, 8))
    for order, quantity in enumerate(_QUANTITIES):
        worst = np.zeros(4)
        _check_derivative(motion.parameters, order, bounds[order].copy(), scratch, worst)
        if worst[0] > 0.0:
            allowed = (
                (limits.lower, limits.upper) if order == 0 else (limits.planned_velocity, limits.given_acceleration)
            )
            raise TrajectoryError(_excess(limits, quantity, worst, allowed[order - 1] if order else allowed))
    if (effort := excessive_effort(motion, limits)) is not None:
        raise TrajectoryError(_excess(limits, "effort", effort, limits.effort))


def excessive_effort(motion: PiecewiseMotion, limits: MotionLimits) -> Array | None:
    """Excess (N m or N), joint, value and time (s) of the largest excess of effort, shape (4,); None: there is none."""
    if limits.model is None or np.isinf(limits.effort).all():
        return None
    # A copy, because the model has scratch space of its own, and several threads may check.
    model = limits.model._replace(parameters=limits.model.parameters.copy())
    worst, states, intervals = np.zeros(4), np.empty((10, len(limits.joints))), np.empty((50, 2))
    largest_excess(motion.parameters, model, limits.places, limits.effort, states, intervals, worst)
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
    if quantity == "velocity":
        range_ += f" ({100.0 * PLANNED_SHARE:g} % of limits.velocity, beyond which the controller stops)"
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
