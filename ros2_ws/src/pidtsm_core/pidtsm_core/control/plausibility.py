"""Detection of implausible measurements: a single sample that is far off must not move the arm."""

from pidtsm_core.compiled import inlined
from pidtsm_core.control.state import Clock, ControllerConfig, ControllerState
from pidtsm_core.control.trust import distrust
from pidtsm_core.parameters import Array
from pidtsm_core.signals import Signal

_SLACK = 0.01
"""rad; a deviation up to this is always plausible."""
TOLERATED = 5
"""Number of consecutive implausible measurements of a joint that are replaced; the next one is accepted."""


@inlined
def doubt(config: ControllerConfig, state: ControllerState, dt: float) -> int:
    """Replace implausible measurements with the position that the estimates predict dt (s) after the last sample.

    A measurement is implausible if it is farther from this prediction than ``plausibility.velocity`` allows in dt.

    Returns:
        The joint, counted from 1, with too many consecutive implausible measurements: its measurement is accepted, and
        the caller reports a fault. 0: no such joint.
    """
    y, measured, doubted, wrong, replaced = state.signals, state.measured, state.doubted, 0, False
    for j in range(measured.size):
        if config.plausible_velocity[j] <= 0.0 or not _off(config, y, measured, j, dt):
            doubted[j] = 0.0
        elif doubted[j] < TOLERATED:
            doubted[j] += 1.0
            measured[j] = y[Signal.POSITION, j] + dt * y[Signal.VELOCITY, j]
            replaced = True
        else:
            doubted[j] = 0.0
            distrust(state, j)
            wrong = j + 1
    if replaced or wrong:
        state.clock[Clock.IMPLAUSIBLE] += 1
    return wrong


@inlined
def _off(config: ControllerConfig, y: Array, measured: Array, j: int, dt: float) -> bool:
    off = abs(measured[j] - y[Signal.POSITION, j] - dt * y[Signal.VELOCITY, j])
    return off > _SLACK + config.plausible_velocity[j] * dt
