"""Continuous joints: positions a whole turn apart are the same, and the arm takes the shorter way."""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.state import ControllerState, part
from pidtsm_core.signals import Signal


@inlined
def _whole_turns(angle: float, turn: float) -> float:
    """The multiple of `turn` (rad) nearest to an angle (rad); 0 for a joint that is not continuous (turn 0)."""
    return turn * math.floor(angle / turn + 0.5) if turn > 0.0 else 0.0


@part
def unwind_measurement(config: ControllerConfig, state: ControllerState) -> None:
    """Take the measured position of a continuous joint at the turn nearest to the last estimate.

    Encoders of such joints often report an angle within one turn.
    """
    y, measured = state.signals, state.measured
    for j in range(measured.size):
        measured[j] += _whole_turns(y[Signal.POSITION, j] - measured[j], config.turn[j])


@part
def turn_reference(config: ControllerConfig, state: ControllerState, followed: bool) -> None:
    """Choose the turns that are added to the reference of a continuous joint.

    Args:
        config: configuration, which is read.
        state: state, which is changed.
        followed: whether a reference was followed at the last sample. Then the reference goes on at the turn nearest to
            the last one; otherwise it begins at the turn nearest to the desired motion, which is the shorter way.
    """
    for j in range(state.turned.size):
        near, wanted = state.referred[j] if followed else state.desired[0, j], state.reference[0, j]
        state.turned[j] = _whole_turns(near - wanted, config.turn[j])
        state.referred[j] = wanted + state.turned[j]


@inlined
def distance(turn: Array, a: Array, b: Array, joint: int) -> float:
    """Distance between two positions of a joint, the shorter way round.

    Args:
        turn: 2 pi for a continuous joint, else 0, shape (joints,), rad.
        a: positions, shape (joints,), rad.
        b: likewise.
        joint: index of the joint.
    """
    apart = a[joint] - b[joint]
    return abs(apart - _whole_turns(apart, turn[joint]))
