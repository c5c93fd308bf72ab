"""Changes without a step of the effort: of gains, of the model, and from a stop back to the law.

What the law demanded for the last sample before and after the change differs. This difference is added to the efforts,
and fades, slowly enough for the law to take over.
"""

import math

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.state import Condition, ControllerState, Handover, part
from pidtsm_core.control.tick import demand_again
from pidtsm_core.signals import Signal

_FADES_IN = 0.25
"""s; time constant with which the difference fades."""
_LARGEST_CHANGE = 0.01
"""Largest change of the difference from one command to the next, as a share of the effort limit."""
_NOTHING = 1e-4
"""A difference below this share of the effort limit has faded."""


@inlined
def expect_handover(state: ControllerState) -> None:
    """The controller has changed: the next command continues from the last one, if there was one."""
    if state.conditions[Condition.COMMANDED] != 0:
        state.conditions[Condition.HANDOVER] = Handover.PENDING


@part
def begin_handover(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Find what the change of the controller, which demands other efforts now, makes of the last command.

    Args:
        config: configuration, which is read.
        state: state, which is changed.
        dt: time between the last two commands, s.
    """
    demand_again(config, state, dt)
    for j in range(state.sent.size):
        difference = state.sent[j] - state.signals[Signal.EFFORT, j]
        state.handover[j] = difference if math.isfinite(difference) else 0.0
        state.signals[Signal.EFFORT, j] = state.sent[j]  # The estimator needs what was applied.
    state.conditions[Condition.HANDOVER] = Handover.FADING


@part
def fade_handover(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Let what is added to the law's effort fade over dt (s)."""
    difference, fades = state.handover, False
    for j in range(difference.size):
        change = min(abs(difference[j]) * min(dt / _FADES_IN, 1.0), _LARGEST_CHANGE * config.limits.effort[j])
        difference[j] -= min(max(difference[j], -change), change)
        fades = fades or abs(difference[j]) > _NOTHING * config.limits.effort[j]
    if not fades:
        state.conditions[Condition.HANDOVER] = Handover.NONE
