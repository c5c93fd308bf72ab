"""Friction of the joints that is compensated.

It follows the velocity of the reference, which is free of noise. That does not help a joint that sticks: friction
balances whatever acts on it until the observer has found the disturbance, and then the joint slides too far. So the
Coulomb friction is that of q_d' - lambda e, the velocity with which the error would decay, which Slotine and Li (1987)
follow: a joint that lags is pressed with more effort, one that leads with less. Where the reference moves, its velocity
decides the sign, so nothing becomes rougher; near a reversal and at rest, the error acts like a stiff spring as long as
friction holds the joint. The error adds at most `_SURE` of the compensated friction: less than what holds a warm joint,
so it alone cannot move one.

Slotine and Li, "On the adaptive control of robot manipulators", Int. J. Robotics Research 6(3), 1987.
"""

import math

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.state import ControllerState
from pidtsm_core.signals import Signal

REVERSAL = 0.01
"""rad/s; below this velocity, the compensated Coulomb friction goes to zero."""
_SURE = 0.7
"""Share of the compensated Coulomb friction that is there even if the gears are warm."""


@inlined
def friction(config: ControllerConfig, velocity: float, joint: int) -> float:
    """Friction that ``compensation`` describes, of a joint with this velocity (rad/s), N m."""
    return coulomb_friction(config, velocity, joint) + config.compensation.viscous[joint] * velocity


@inlined
def coulomb_friction(config: ControllerConfig, velocity: float, joint: int) -> float:
    """The Coulomb part of `friction`, N m."""
    return config.compensation.coulomb[joint] * math.tanh(velocity / REVERSAL)


@inlined
def press(config: ControllerConfig, state: ControllerState, velocity: float, joint: int) -> float:
    """What the error adds to the compensated friction of a joint with this velocity of the reference (rad/s), N m.

    It is kept in ``state.pressed``; an error that is not finite adds nothing.
    """
    wanted = velocity - config.compensation.error_gain[joint] * state.signals[Signal.POSITION_ERROR, joint]
    more = _SURE * (coulomb_friction(config, wanted, joint) - coulomb_friction(config, velocity, joint))
    state.pressed[joint] = more if math.isfinite(more) else 0.0
    return state.pressed[joint]
