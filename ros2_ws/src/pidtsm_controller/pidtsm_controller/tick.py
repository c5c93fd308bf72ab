"""What the controller node computes for one joint state, in one call of compiled code with few arguments."""

from enum import IntEnum

import numpy as np

from pidtsm_core.compiled import njit
from pidtsm_core.controller import ControllerConfig, ControllerState, parts, tick
from pidtsm_core.laws import Numbers
from pidtsm_core.parameters import Array
from pidtsm_core.polynomials import add_quintic, quintic
from pidtsm_core.references import extrapolate
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.signals import Signal
from pidtsm_core.timing import seconds


class Row(IntEnum):
    """Rows of a node's table, shape (ROWS, joints); a limit of 0 is none."""

    MEASURED = 0  # q, rad
    REFERENCE = 1  # q_d, q_d', q_d'' as received, three rows
    DESIRED = 4  # the same at the last tick, three rows
    OFFSET = 7  # coefficients of the way from where the arm was to the reference, six rows
    BLEND = 13  # how long that way takes, s
    SATURATED = 14  # number of ticks at the torque limit
    EFFORT = 15  # the torque before this tick, N m
    EFFORT_RATE = 16  # its largest change, N m/s
    POSITION = 17  # largest |q|, rad
    VELOCITY = 18  # largest |q'|, rad/s
    TRACKING = 19  # largest |e|, rad
    GRAVITY = 20  # 1: the safe torque carries the arm
    DAMPING = 21  # of the safe torque, N m s/rad
    REST = 22  # zeros, three rows
    DIFFERENCE = 25  # scratch, three rows


ROWS = 28


class Violation(IntEnum):
    """Limits that a tick found exceeded: powers of two, to be added."""

    POSITION = 1
    VELOCITY = 2
    TRACKING = 4


@njit
def _safe(config: ControllerConfig, state: ControllerState, table: Array) -> None:
    """Gravity's torque, where wanted, less damping, within the limits."""
    y = state.signals
    for j in range(y.shape[1]):
        state.accelerations[0, j] = 0.0
        state.accelerations[1, j] = 0.0
    still = table[Row.REST]
    efforts = y[Signal.EQUIVALENT_EFFORT : Signal.EFFORT + 1]
    inverse_dynamics(config.robot, y[Signal.POSITION], still, state.accelerations, config.model, efforts)
    for j in range(y.shape[1]):
        limit = config.effort_limit[j]
        effort = efforts[1, j] * table[Row.GRAVITY, j] - table[Row.DAMPING, j] * y[Signal.VELOCITY, j]
        effort = min(max(effort, -limit), limit) if np.isfinite(effort) else 0.0
        y[Signal.EFFORT, j] = effort
        y[Signal.SATURATED, j] = 1.0 if abs(effort) >= limit else 0.0


@njit
def _publishable(state: ControllerState, table: Array, effort: Array, signals: Array, period: float) -> None:
    """Limit the torque's rate and write what the messages take."""
    y = state.signals
    for j in range(effort.size):
        change = table[Row.EFFORT_RATE, j] * period
        if change > 0.0:
            last = table[Row.EFFORT, j]
            y[Signal.EFFORT, j] = min(max(y[Signal.EFFORT, j], last - change), last + change)
        effort[j] = table[Row.EFFORT, j] = y[Signal.EFFORT, j]
    for i in range(signals.shape[0]):
        for j in range(effort.size):
            signals[i, j] = y[i, j]


@njit
def answer(
    memory: Array,
    numbers: Numbers,
    table: Array,
    effort: Array,
    signals: Array,
    reference_age: int,
    period: int,
    blend_age: int,
    holding: bool,
    stopped: bool,
) -> int:
    """One tick.

    Args:
        memory: of the controller, see `parts`.
        numbers: likewise.
        table: see `Row`.
        effort: result, shape (joints,), N m.
        signals: result, shape (len(Signal), joints).
        reference_age: of the reference at the sample, ns.
        period: since the last tick, ns; 0 at the first.
        blend_age: since the reference is followed, ns.
        holding: the position desired last is held, instead of the reference.
        stopped: the safe torque instead of the law's.

    Returns:
        Exceeded limits, see `Violation`.
    """
    config, state = parts(memory, numbers)
    desired = table[Row.DESIRED : Row.DESIRED + 3]
    blend = table[Row.BLEND, 0]
    if not holding:
        extrapolate(table[Row.REFERENCE : Row.REFERENCE + 3], seconds(reference_age), desired)
        if seconds(blend_age) < blend:
            add_quintic(table[Row.OFFSET : Row.OFFSET + 6], blend, seconds(blend_age), desired)
    dt = seconds(period)
    # No estimator of a node reads the truth.
    tick(config, state, table[Row.MEASURED], desired, desired, dt)
    y = state.signals
    violations = 0
    for j in range(effort.size):
        table[Row.SATURATED, j] += y[Signal.SATURATED, j]
        if 0.0 < table[Row.POSITION, j] < abs(table[Row.MEASURED, j]):
            violations |= Violation.POSITION
        if 0.0 < table[Row.VELOCITY, j] < abs(y[Signal.VELOCITY, j]):
            violations |= Violation.VELOCITY
        if 0.0 < table[Row.TRACKING, j] < abs(y[Signal.POSITION_ERROR, j]):
            violations |= Violation.TRACKING
    if stopped:
        _safe(config, state, table)
    _publishable(state, table, effort, signals, dt)
    return violations


@njit
def make_safe(memory: Array, numbers: Numbers, table: Array, effort: Array, signals: Array) -> None:
    """Replace the torque of the last tick by the safe one; arguments as those of `answer`."""
    config, state = parts(memory, numbers)
    _safe(config, state, table)
    _publishable(state, table, effort, signals, 0.0)


@njit
def hold(table: Array, position: Array) -> None:
    """Desire rest at `position`, shape (joints,), rad."""
    for j in range(position.size):
        table[Row.DESIRED, j] = position[j]
        table[Row.DESIRED + 1, j] = 0.0
        table[Row.DESIRED + 2, j] = 0.0


@njit
def begin_following(table: Array, reference_age: int) -> None:
    """Plan the way from the motion desired last to the reference: their difference dies out in a quintic.

    Args:
        table: see `Row`.
        reference_age: of the reference at the sample, ns.
    """
    blend = table[Row.BLEND, 0]
    if blend <= 0.0:
        return
    difference = table[Row.DIFFERENCE : Row.DIFFERENCE + 3]
    extrapolate(table[Row.REFERENCE : Row.REFERENCE + 3], seconds(reference_age), difference)
    for i in range(3):
        for j in range(table.shape[1]):
            difference[i, j] = table[Row.DESIRED + i, j] - difference[i, j]
    quintic(difference, table[Row.REST : Row.REST + 3], blend, table[Row.OFFSET : Row.OFFSET + 6])
