"""Which measurements cannot be: one sample that is far off must not move the arm."""

from pidtsm_core.compiled import njit
from pidtsm_core.control.state import Clock, ControllerConfig, ControllerState
from pidtsm_core.parameters import Array
from pidtsm_core.signals import Signal

_SLACK = 0.01
"""rad that any measurement may be off."""
TOLERATED = 5
"""Measurements in a row that are replaced; with one more it is not the measurement that is wrong."""


@njit
def doubt(config: ControllerConfig, state: ControllerState, dt: float) -> int:
    """Replace measurements that are too far from where the estimates put the arm dt (s) later by where that is.

    Too far is what ``plausibility.velocity`` does not bring about in dt.

    Returns:
        The joint, from 1, whose measurements have been too far off too often: they are to be believed, and explained.
        0: there is none.
    """
    y, clock, measured, wrong = state.signals, state.clock, state.measured, 0
    for j in range(measured.size):
        if config.plausible_velocity[j] > 0.0 and _off(config, y, measured, j, dt):
            wrong = j + 1
    if wrong == 0:
        clock[Clock.DOUBTED] = 0
        return 0
    clock[Clock.DOUBTED] += 1
    clock[Clock.IMPLAUSIBLE] += 1
    if clock[Clock.DOUBTED] > TOLERATED:
        clock[Clock.DOUBTED] = 0
        return wrong
    for j in range(measured.size):
        if config.plausible_velocity[j] > 0.0 and _off(config, y, measured, j, dt):
            measured[j] = y[Signal.POSITION, j] + dt * y[Signal.VELOCITY, j]
    return 0


@njit
def _off(config: ControllerConfig, y: Array, measured: Array, j: int, dt: float) -> bool:
    off = abs(measured[j] - y[Signal.POSITION, j] - dt * y[Signal.VELOCITY, j])
    return off > _SLACK + config.plausible_velocity[j] * dt
