"""Freedrive: the arm carries itself, and a person moves it by hand.

A spring and a damper tie each joint to an anchor. Where the spring needs more effort than ``freedrive.resistance``, the
anchor slips along, like dry friction: the arm stays where it is left, even if the model is wrong, and nothing but a
push sets it in motion (the elasto-plastic model of Dupont, Hayward, Armstrong and Altpeter, "Single state elastoplastic
friction models", IEEE Transactions on Automatic Control 47(5), 2002). The anchor moves at ``freedrive.velocity`` at
most, and not out of the range of its joint; beyond, the spring holds the arm back.
"""

import math

from pidtsm_core.compiled import inlined
from pidtsm_core.control.effort import friction, limit_effort
from pidtsm_core.control.safe import learn
from pidtsm_core.control.state import Clock, ControllerConfig, ControllerState, Hold, part
from pidtsm_core.robots import forward_dynamics, inverse_dynamics
from pidtsm_core.signals import Signal
from pidtsm_core.timing import seconds

_BANDWIDTH, _OF_RATE = 40.0, 0.08
"""Natural frequency of the springs, rad/s, and its largest value as a multiple of the rate of the joint states."""
_COMPENSATED = 0.7
"""Share of the friction that is compensated: the arm must not move by itself if its friction is less than modelled."""
_RECOIL = 2.0
_SETTLES = 6.0
_DAMPING = 2.4
_MOVES, _TRUSTED = 0.05, 0.8
_EASES, _CHANGE = 0.05, 0.02
_MARGIN, _LARGEST_MARGIN = 0.05, 0.1
"""Distance of the anchor from a position limit, as a share of the range of the joint; and in rad or m."""


@part
def make_free(config: ControllerConfig, state: ControllerState, stamp: int, dt: float) -> None:
    """Replace the effort for the joint state of `stamp` (ns), dt (s) after the last one, with that of freedrive."""
    y, hold, clock, efforts = state.signals, state.hold, state.clock, state.scratch
    begins, bandwidth = clock[Clock.FREED] == 0, _bandwidth(state)
    if begins:
        _begin(config, state, stamp)
        dt = 0.0
    # The inertia changes slowly: that of one joint at each sample is enough.
    _weigh(config, state, clock[Clock.ANSWERED] % y.shape[1])
    _pull(config, state, bandwidth)
    _slip(config, state, bandwidth, dt)
    _damp(config, state, bandwidth, _eased(state, stamp))
    gravity, pull, damping = efforts[0], efforts[1], efforts[3]
    for j in range(y.shape[1]):
        state.added[j] = _compensation(config, state, j, pull[j])
        y[Signal.EQUIVALENT_EFFORT, j] = gravity[j]
        y[Signal.EFFORT, j] = gravity[j] + pull[j] + damping[j] + hold[Hold.LEARNT, j] + state.added[j]
    limit_effort(config, state)
    _ease(config, state, stamp, begins)
    limit_effort(config, state)


@inlined
def _begin(config: ControllerConfig, state: ControllerState, stamp: int) -> None:
    """Tie the arm to anchors where it is, and limit what the law has learnt of a load.

    It may be wrong, so it is no more than what the springs hold back: on its joint, and on every joint that it moves.
    """
    hold, y, efforts, bandwidth = state.hold, state.signals, state.scratch, _bandwidth(state)
    state.clock[Clock.FREED] = stamp + 1
    learn(config, state)
    for j in range(hold.shape[1]):
        _weigh(config, state, j)
        hold[Hold.ANCHOR, j] = y[Signal.POSITION, j]
        hold[Hold.SLIP, j] = 0.0
    _pull(config, state, bandwidth)
    for j in range(hold.shape[1]):
        most = _trust(state, j) * _held(config, state, bandwidth, j)
        hold[Hold.LEARNT, j] = min(max(hold[Hold.LEARNT, j], -most), most)
        state.net[j] = efforts[0, j] + hold[Hold.LEARNT, j]
    forward_dynamics(config.model, y[Signal.POSITION], efforts[5], state.net, efforts[4])
    share = 1.0
    for j in range(hold.shape[1]):
        most = _trust(state, j) * bandwidth * bandwidth * _longest(config, bandwidth, j)
        share = min(share, most / abs(efforts[4, j])) if efforts[4, j] != 0.0 else share
    for j in range(hold.shape[1]):
        hold[Hold.LEARNT, j] *= share


@inlined
def _trust(state: ControllerState, joint: int) -> float:
    """Share of the resistance of a joint up to which something learnt is believed."""
    return 1.0 if abs(state.signals[Signal.VELOCITY, joint]) < _MOVES else _TRUSTED


@inlined
def _eased(state: ControllerState, stamp: int) -> float:
    """Share of the dampers that acts, from 0 at the beginning, so that an arm that moves is not stopped with a jerk."""
    since = seconds(stamp + 1 - state.clock[Clock.FREED])
    return since / _EASES if 0.0 <= since < _EASES else 1.0


@inlined
def _ease(config: ControllerConfig, state: ControllerState, stamp: int, begins: bool) -> None:
    """Fade from the last command to the effort of freedrive, all joints together."""
    efforts, offset, largest = state.signals[Signal.EFFORT], state.hold[Hold.OFFSET], 0.0
    for j in range(efforts.size):
        if begins:
            offset[j] = state.sent[j] - efforts[j]
        largest = max(largest, abs(offset[j]) / config.effort_limit[j])
    left = max(1.0 - _CHANGE / largest, 0.0) if largest > 0.0 else 0.0
    for j in range(efforts.size):
        offset[j] *= left
        efforts[j] += offset[j]


@inlined
def _bandwidth(state: ControllerState) -> float:
    """Natural frequency of the springs, rad/s."""
    period = state.clock[Clock.PERIOD]
    return min(_BANDWIDTH, _OF_RATE / seconds(period)) if period > 0 else _BANDWIDTH


@inlined
def _held(config: ControllerConfig, state: ControllerState, bandwidth: float, joint: int) -> float:
    """Effort on a joint alone that its spring holds at least, N m."""
    light = bandwidth * bandwidth * _longest(config, bandwidth, joint) * state.hold[Hold.LIGHTEST, joint]
    return min(config.resistance[joint], light)


@part
def _weigh(config: ControllerConfig, state: ControllerState, joint: int) -> None:
    """Update the inertias of a joint."""
    motion, efforts, q = state.motion, state.scratch, state.signals[Signal.POSITION]
    for j in range(q.size):
        motion[0, j] = motion[1, j] = efforts[5, j] = 0.0
    motion[1, joint] = 1.0
    inverse_dynamics(config.model, q, efforts[5], motion[:2], efforts[:2])
    state.hold[Hold.INERTIA, joint] = efforts[1, joint] - efforts[0, joint]
    efforts[0, joint] += 1.0
    forward_dynamics(config.model, q, efforts[5], efforts[0], efforts[4])
    state.hold[Hold.LIGHTEST, joint] = 1.0 / efforts[4, joint] if efforts[4, joint] > 0.0 else 0.0


@part
def _pull(config: ControllerConfig, state: ControllerState, bandwidth: float) -> None:
    """Write the effort that carries the arm, and that of the springs, to the first rows of ``state.scratch``."""
    motion, efforts, q = state.motion, state.scratch, state.signals[Signal.POSITION]
    for j in range(q.size):
        motion[0, j] = efforts[5, j] = 0.0
        motion[1, j] = bandwidth * bandwidth * (state.hold[Hold.ANCHOR, j] - q[j])
    inverse_dynamics(config.model, q, efforts[5], motion[:2], efforts[:2])
    for j in range(q.size):
        efforts[1, j] -= efforts[0, j]


@inlined
def _slip(config: ControllerConfig, state: ControllerState, bandwidth: float, dt: float) -> None:
    """Move the anchors over dt (s), one after the other, as far as their springs yield."""
    hold = state.hold
    passed = -math.expm1(-_SETTLES * bandwidth * dt)
    for j in range(hold.shape[1]):
        most = config.free_velocity[j] * dt
        slip = min(max(passed * _excess(config, state, bandwidth, j), -most), most)
        if _leaves_range(config, hold[Hold.ANCHOR, j] + slip, slip, j):
            slip = 0.0
        if slip != 0.0:
            hold[Hold.ANCHOR, j] += slip
            _pull(config, state, bandwidth)  # A change of one spring pulls at all joints.
        if dt > 0.0:
            hold[Hold.SLIP, j] += passed * (slip / dt - hold[Hold.SLIP, j])


@inlined
def _excess(config: ControllerConfig, state: ControllerState, bandwidth: float, joint: int) -> float:
    """How far the anchor of a joint has to move, rad."""
    pull, inertia = state.scratch[1, joint], state.hold[Hold.INERTIA, joint]
    if inertia <= 0.0:
        return 0.0
    stiffness = bandwidth * bandwidth * inertia
    stretch = (state.hold[Hold.ANCHOR, joint] - state.signals[Signal.POSITION, joint]) * math.copysign(1.0, pull)
    relaxed = abs(pull) / stiffness
    least = (abs(pull) - config.resistance[joint]) / stiffness
    excess = max(least, min(stretch - _longest(config, bandwidth, joint), relaxed), 0.0)
    return -math.copysign(excess, pull)


@inlined
def _longest(config: ControllerConfig, bandwidth: float, joint: int) -> float:
    return _RECOIL * config.free_velocity[joint] / bandwidth


@inlined
def _damp(config: ControllerConfig, state: ControllerState, bandwidth: float, eased: float) -> None:
    """Write the effort of the dampers to ``state.scratch[3]``; a joint that slips has less, up to none.

    The damping matrix is S H S, where S is diagonal, so it is symmetric and takes energy whatever the velocities are.
    """
    motion, efforts, y = state.motion, state.scratch, state.signals
    for j in range(y.shape[1]):
        motion[0, j] = -_DAMPING * eased * bandwidth * _share(config, state, bandwidth, j) * y[Signal.VELOCITY, j]
        efforts[5, j] = 0.0
    inverse_dynamics(config.model, y[Signal.POSITION], efforts[5], motion[:1], efforts[3:4])
    for j in range(y.shape[1]):
        efforts[3, j] = (efforts[3, j] - efforts[0, j]) * _share(config, state, bandwidth, j)


@inlined
def _share(config: ControllerConfig, state: ControllerState, bandwidth: float, joint: int) -> float:
    """Square root of the share of the velocity of a joint that is damped."""
    velocity, pull = state.signals[Signal.VELOCITY, joint], state.scratch[1, joint]
    if pull * velocity >= 0.0:
        return 1.0
    stretch = (state.hold[Hold.ANCHOR, joint] - state.signals[Signal.POSITION, joint]) * math.copysign(1.0, pull)
    loose = min(max(abs(pull) / config.resistance[joint], stretch / _longest(config, bandwidth, joint)), 1.0)
    return math.sqrt(1.0 - loose * min(config.free_velocity[joint] / abs(velocity), 1.0))


@inlined
def _compensation(config: ControllerConfig, state: ControllerState, joint: int, pull: float) -> float:
    """Effort that compensates a part of the friction of a joint that slips, N m: less than what its spring takes."""
    effort, most = _COMPENSATED * friction(config, state.hold[Hold.SLIP, joint], joint), _COMPENSATED * abs(pull)
    return min(max(effort, -most), most) if effort * pull < 0.0 else 0.0


@inlined
def _leaves_range(config: ControllerConfig, anchor: float, direction: float, joint: int) -> bool:
    """Whether an anchor at this position (rad) that moves in this direction is too near to a position limit."""
    low, high = config.min_position[joint], config.max_position[joint]
    margin = min(_MARGIN * (high - low), _LARGEST_MARGIN)
    too_near = (direction > 0.0 and anchor > high - margin) or (direction < 0.0 and anchor < low + margin)
    return low != high and too_near


@part
def hand_over(state: ControllerState) -> None:
    """Apply the effort of freedrive once more; what it is beyond that of the law stays until the next approach."""
    efforts = state.signals[Signal.EFFORT]
    for j in range(efforts.size):
        beyond = state.sent[j] - efforts[j]
        state.handed[j] = state.handed_before[j] = beyond
        efforts[j] = state.sent[j]
    state.clock[Clock.FREED] = 0
