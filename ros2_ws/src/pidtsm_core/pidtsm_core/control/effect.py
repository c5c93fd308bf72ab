"""Efforts that should move the arm, and do not: a joint is locked or unpowered, or its measurement is stuck.

The sign of all three is a measured position that does not change by a single bit while the effort changes by much. The
effort that counts is what the measured motion does not explain, see contact.py, so that a joint may rest while others
move its load. A wall or static friction holds a joint, too, but it yields or slips before the effort has changed so
much. An arm of which no joint moves is noticed sooner: its source may send its last state again and again.
"""

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.state import ControllerState, External, Still, Time, part
from pidtsm_core.control.trust import distrust
from pidtsm_core.timing import seconds

_SHARE, _SHARE_OF_ALL = 0.5, 0.3
"""Change of the effort that should have moved one joint, or all joints, as a share of the effort limit."""
_SETTLED, _LONG = 0.1, 0.2
"""s without a change of position after which the effort is remembered, and after which its changes count: at first the
estimates still show the motion before."""


@inlined
def watch_effect(config: ControllerConfig, state: ControllerState) -> int:
    """The joint (counted from 1) on which the effort has no effect; 0: none."""
    still, measured, resting = state.still, state.measured, 0
    for j in range(measured.size):
        if measured[j] != still[Still.POSITION, j]:
            still[Still.POSITION, j] = measured[j]
            still[Still.SAMPLES, j] = 0.0
        else:
            still[Still.SAMPLES, j] += 1.0
            resting += 1
    return _idle_joint(config, state, resting == measured.size) if resting else 0


@part
def _idle_joint(config: ControllerConfig, state: ControllerState, all_rest: bool) -> int:
    """Of the joints whose measured position does not change, one with an effort that should have moved it."""
    found, least = 0, _SHARE_OF_ALL if all_rest else _SHARE
    for j in range(state.still.shape[1]):
        rested = state.still[Still.SAMPLES, j] * seconds(state.times[Time.PERIOD])
        if rested < _SETTLED:
            state.still[Still.EFFORT, j] = state.sent[j]
            state.still[Still.DEMANDED, j] = _unexplained(config, state, j)
        # Without a model, an effort that changes may carry a load that other joints move.
        elif rested >= _LONG and (config.senses_contact or all_rest) and _change(config, state, j) > least:
            found = j + 1
    return found


@inlined
def _change(config: ControllerConfig, state: ControllerState, joint: int) -> float:
    """How much the effort on a joint that rests has changed, and not to carry a load: a share of the effort limit."""
    commanded = abs(state.sent[joint] - state.still[Still.EFFORT, joint])
    unexplained = abs(_unexplained(config, state, joint) - state.still[Still.DEMANDED, joint])
    return min(commanded, unexplained) / config.limits.effort[joint]


@inlined
def _unexplained(config: ControllerConfig, state: ControllerState, joint: int) -> float:
    """Effort on a joint that its measured motion does not explain, N m."""
    return -state.external[External.TWICE, joint] if config.senses_contact else state.sent[joint]


@part
def distrust_idle(config: ControllerConfig, state: ControllerState) -> None:
    """Distrust the joints on which the effort seems to have no effect: all, if none of them moves."""
    still, all_rest = state.still, True
    for j in range(still.shape[1]):
        all_rest = all_rest and still[Still.SAMPLES, j] > 0.0
    for j in range(still.shape[1]):
        rested = still[Still.SAMPLES, j] * seconds(state.times[Time.PERIOD])
        if all_rest or (rested >= _LONG and _change(config, state, j) > _SHARE):
            distrust(state, j)
