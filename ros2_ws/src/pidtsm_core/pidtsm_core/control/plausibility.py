"""Detection of implausible measurements: a single sample that is far off must not move the arm."""

from pidtsm_core.compiled import inlined
from pidtsm_core.control.state import Clock, ControllerConfig, ControllerState
from pidtsm_core.parameters import Array
from pidtsm_core.signals import Signal

_SLACK = 0.01
"""rad; a deviation up to this is always plausible."""
TOLERATED = 5
"""Number of consecutive implausible measurements that are replaced; with one more, the measurement is accepted."""


@inlined
def doubt(config: ControllerConfig, state: ControllerState, dt: float) -> int:
    """Replace implausible measurements with the position that the estimates predict dt (s) after the last sample.

    A measurement is implausible if it is farther from this prediction than ``plausibility.velocity`` allows in dt.

    Returns:
        The joint, counted from 1, with too many consecutive implausible measurements: its measurement is accepted, and
        the caller reports a fault. 0: no such joint.
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


@inlined
def _off(config: ControllerConfig, y: Array, measured: Array, j: int, dt: float) -> bool:
    off = abs(measured[j] - y[Signal.POSITION, j] - dt * y[Signal.VELOCITY, j])
    return off > _SLACK + config.plausible_velocity[j] * dt
