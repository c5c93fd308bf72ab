"""Detection of implausible measurements: a single sample that is far off must not move the arm."""

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.state import Condition, ControllerState, Count, Held, Hold
from pidtsm_core.control.trust import SLACK, distrust, is_doubtful
from pidtsm_core.signals import Signal

TOLERATED = 5
"""Number of consecutive implausible measurements of a joint that are replaced; the next one is accepted."""


@inlined
def doubt(config: ControllerConfig, state: ControllerState, dt: float) -> int:
    """Replace implausible measurements with the position that the estimates predict dt (s) after the last sample.

    A measurement is implausible if it is farther from this prediction than ``plausibility.velocity`` allows in dt.
    While the arm is held, the hold's own motion predicts it, because the estimates may be part of the fault.

    Returns:
        The joint, counted from 1, with too many consecutive implausible measurements: its measurement is accepted, and
        the caller reports a fault. 0: no such joint.
    """
    y, measured, implausible, wrong, replaced = state.signals, state.measured, state.implausible, 0, False
    held = config.stop.holds and state.conditions[Condition.HELD] == Held.HERE
    positions, velocities = y[Signal.POSITION], y[Signal.VELOCITY]
    if held:  # The estimates may be part of the fault.
        positions, velocities = state.hold[Hold.POSITION], state.hold[Hold.VELOCITY]
    for j in range(measured.size):
        predicted = positions[j] + dt * velocities[j]
        off = abs(measured[j] - predicted) > SLACK + config.plausible_velocity[j] * dt
        if config.plausible_velocity[j] <= 0.0 or not off or (held and is_doubtful(state, j)):
            implausible[j] = 0.0
        elif implausible[j] < TOLERATED:
            implausible[j] += 1.0
            measured[j] = predicted
            replaced = True
        else:
            implausible[j] = 0.0
            distrust(state, j)
            wrong = j + 1
    if replaced or wrong:
        state.counts[Count.IMPLAUSIBLE] += 1
    return wrong
