"""Joints whose measurements a stopped controller does not believe, because they have jumped or do not change.

At first such a joint is blind: it is taken to move as desired. Once its measurements are steady they are used again,
but for the motion only: an encoder that has slipped or changed its sign still measures how far a joint moves. The sign
follows from the motion before; if the hold drives the joint away, it was wrong.
"""

import math

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.state import ControllerState, Hold
from pidtsm_core.signals import Fault, Status

_NEAR = 0.03
"""rad; a position that is nearer to the desired one was measured rightly again."""
SLACK = 0.01
"""rad; a step up to this, beyond what the joint can move, is no jump, and plausible."""
_SHARE = 0.25
"""Of plausibility.velocity, that a joint which is being stopped may have."""
_LONG = 0.02
"""s without a jump after which measurements are used again."""
_SLOW = 0.1
"""rad/s; slower motions do not show a sign."""
_STRAYED, _GROWS, _TREND = 0.02, 1.3, 0.02
"""rad, factor, s: a joint farther from its desired position departs from it if its velocity has grown by this factor,
compared with that filtered over this time."""
REVERSALS = 3


@inlined
def used_position(config: ControllerConfig, state: ControllerState, joint: int, dt: float) -> float:
    """The position of a joint that the hold uses, dt (s) after the last: as measured, or as far as it is believed."""
    if state.hold[Hold.DISTRUSTED, joint] != 0.0:
        _watch(config, state, joint, dt)
    if state.hold[Hold.DISTRUSTED, joint] != 0.0:
        return state.desired[0, joint]
    if state.hold[Hold.SIGN, joint] != 0.0:
        _follow_jump(config, state, joint, dt)
    return used_position_of(state, joint)


@inlined
def used_position_of(state: ControllerState, joint: int) -> float:
    """The position of a joint that is believed, in part or wholly."""
    hold, q = state.hold, state.measured[joint]
    return q if hold[Hold.SIGN, joint] == 0.0 else hold[Hold.SIGN, joint] * q + hold[Hold.SHIFT, joint]


@inlined
def _watch(config: ControllerConfig, state: ControllerState, joint: int, dt: float) -> None:
    """Use the measurements of a blind joint again if they have been steady for long enough.

    Measurements that have stopped changing while the effort changed are not used as long as they stay the same. If they
    change, the encoder lives: the arm was locked, or not powered.
    """
    hold, q = state.hold, state.measured[joint]
    jumps = abs(q - hold[Hold.SEEN, joint]) > SLACK + config.plausible_velocity[joint] * dt
    hold[Hold.SEEN, joint] = q
    hold[Hold.STEADY, joint] = 0.0 if jumps else hold[Hold.STEADY, joint] + dt
    if state.status[Status.FAULT] == Fault.NO_EFFECT and q == hold[Hold.STEADY_FROM, joint]:
        hold[Hold.STEADY, joint] = 0.0
    time = hold[Hold.STEADY, joint]
    if time == 0.0:
        hold[Hold.STEADY_FROM, joint] = q
    elif time >= _LONG:
        velocity = (q - hold[Hold.STEADY_FROM, joint]) / time
        opposite = velocity * hold[Hold.BEFORE, joint] < 0.0
        clear = min(abs(velocity), abs(hold[Hold.BEFORE, joint])) > _SLOW
        _use(state, joint, -1.0 if opposite and clear else 1.0, velocity)


@inlined
def _use(state: ControllerState, joint: int, sign: float, velocity: float) -> None:
    """Use the motion that is measured with this sign, and the position if it is near the desired one."""
    hold, off = state.hold, state.desired[0, joint] - sign * state.measured[joint]
    hold[Hold.DISTRUSTED, joint] = 0.0
    hold[Hold.SIGN, joint] = 0.0 if sign > 0.0 and abs(off) <= _NEAR else sign
    hold[Hold.SHIFT, joint] = off
    hold[Hold.POSITION, joint] = used_position_of(state, joint)
    hold[Hold.VELOCITY, joint] = sign * velocity
    hold[Hold.TREND, joint] = sign * velocity - state.desired[1, joint]


@inlined
def _follow_jump(config: ControllerConfig, state: ControllerState, joint: int, dt: float) -> None:
    """If a joint of which only the motion is measured seems to jump, shift its position back; and use it if it fits."""
    hold = state.hold
    predicted = hold[Hold.POSITION, joint] + dt * hold[Hold.VELOCITY, joint]
    if abs(used_position_of(state, joint) - predicted) > SLACK + _SHARE * config.plausible_velocity[joint] * dt:
        hold[Hold.SHIFT, joint] = predicted - hold[Hold.SIGN, joint] * state.measured[joint]
    if hold[Hold.SIGN, joint] > 0.0 and abs(hold[Hold.SHIFT, joint]) <= _NEAR:
        hold[Hold.SIGN, joint] = 0.0


@inlined
def reverse(state: ControllerState, dt: float) -> None:
    """Change the sign of a measured motion that the hold drives away, dt (s) after the last sample."""
    hold = state.hold
    for j in range(state.measured.size):
        if hold[Hold.SIGN, j] != 0.0 and hold[Hold.DISTRUSTED, j] == 0.0:
            e, de = hold[Hold.POSITION, j] - state.desired[0, j], hold[Hold.VELOCITY, j] - state.desired[1, j]
            away = de * math.copysign(1.0, e)
            grows = away > _GROWS * abs(hold[Hold.TREND, j]) and away > state.hold_bandwidth[0] * abs(e)
            hold[Hold.TREND, j] += min(dt / _TREND, 1.0) * (de - hold[Hold.TREND, j])
            if abs(e) > _STRAYED and grows and hold[Hold.REVERSED, j] < REVERSALS:
                change_sign(state, j)
                hold[Hold.TREND, j] = -de
                hold[Hold.INTEGRAL, j] = 0.0
                hold[Hold.REVERSED, j] += 1.0


@inlined
def change_sign(state: ControllerState, joint: int) -> None:
    """Use the measured motion of a joint with the other sign; its position stays as it is taken to be."""
    hold = state.hold
    hold[Hold.SIGN, joint] = 1.0 if hold[Hold.SIGN, joint] < 0.0 else -1.0
    hold[Hold.SHIFT, joint] = hold[Hold.POSITION, joint] - hold[Hold.SIGN, joint] * state.measured[joint]
    hold[Hold.VELOCITY, joint] = -hold[Hold.VELOCITY, joint]


@inlined
def trust(state: ControllerState, joint: int) -> None:
    """Believe the measurements of a joint."""
    for row in range(Hold.DISTRUSTED, Hold.REVERSED + 1):
        state.hold[row, joint] = 0.0


@inlined
def distrust(state: ControllerState, joint: int) -> None:
    """Do not believe the measurements of a joint any more."""
    if state.hold[Hold.DISTRUSTED, joint] == 0.0:
        trust(state, joint)
        state.hold[Hold.DISTRUSTED, joint] = 1.0
        state.hold[Hold.SEEN, joint] = state.hold[Hold.STEADY_FROM, joint] = state.measured[joint]


@inlined
def is_doubtful(state: ControllerState, joint: int) -> bool:
    """Whether the position of a joint is not measured."""
    return state.hold[Hold.DISTRUSTED, joint] != 0.0 or state.hold[Hold.SIGN, joint] != 0.0
