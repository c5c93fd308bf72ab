"""The begin of a stop: from which motion it starts, how the arm comes to rest, and which load it carries.

Nothing here follows from a single measurement or from one estimate alone: of three sources, one may be arbitrarily
wrong.
"""

import math

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.contact import in_contact
from pidtsm_core.control.desired import come_to_rest
from pidtsm_core.control.effort import add_offset, carry, time_of_change
from pidtsm_core.control.history import RECENT, noted_acceleration, noted_effort, noted_motion
from pidtsm_core.control.lateness import remaining
from pidtsm_core.control.learnt_demand import demand_without_error, learnt_acceleration, learnt_effort
from pidtsm_core.control.state import (
    HISTORY,
    Condition,
    ControllerState,
    Count,
    External,
    Held,
    Hold,
    Still,
    Time,
    part,
)
from pidtsm_core.control.trust import is_doubtful
from pidtsm_core.robots import forward_dynamics, inverse_dynamics
from pidtsm_core.signals import Fault, Signal, Status, Stop
from pidtsm_core.timing import NANOSECONDS

QUICKEST, SLOWEST = 0.02, 0.125
"""s; time in which a difference as large as the effort limit fades, so that a stop causes no jolt."""
_FADES_OVER = 0.015
"""rad; way of the arm in this time: an arm that moves fast needs the safe effort sooner."""
_LARGEST_SHARE = 0.5
"""Largest share of the effort limit that is accepted as learnt by the law."""
_LONG_CHANGE = 0.04
"""s; an effort that needs longer to change by its limit cannot follow a way that begins without acceleration."""
_OF_CHANGE = 1.0
"""Largest bandwidth of the hold relative to the inverse of the time in which its effort can change by its limit, which
grows with the time between commands."""
_OF_LATENESS = 0.2
"""Likewise relative to the inverse of the lateness of the drives."""
_SHARE_OF_LIMIT, _AWAY = 0.5, 0.05
"""Largest share of the effort limit that the spring of the hold needs for a distance of the joint, rad: a hold whose
effort is at its limits swings."""
_WAY_TO_REST, _SHORTEST_REST, _LONGEST_REST = 0.03, 0.02, 0.1
"""rad; way to rest that is short enough for the most gentle stop; s, s; times to rest that are tried first."""
_LONG_GAP = 3 * NANOSECONDS // 20  # ns
_NEAR = 0.05
"""rad; an arm that was not seen for a while, and is nearer to its place, is held there again."""
DETOUR = 0.02
"""rad; if a rate limit makes the way to rest longer by more, it is suspended."""
_LARGEST_VELOCITY = 1.5
"""Largest velocity at which a stop may begin, as a multiple of the velocity limit: more is a wrong measurement."""


@inlined
def learn(config: ControllerConfig, state: ControllerState) -> None:
    """Store what the law has learnt: the effort that it adds to that of the model without any error."""
    y, scratch = state.signals, state.scratch
    if config.law.of_arm:
        demand_without_error(config, state)
    for j in range(scratch.shape[1]):
        learnt = learnt_acceleration(config, state, j)
        state.accelerations[0, j] = 0.0
        state.accelerations[1, j] = learnt
        scratch[0, j] = 0.0
        # The output of a law without model is an effort.
        state.hold[Hold.LEARNT, j] = learnt
        state.hold[Hold.INTEGRAL, j] = 0.0
    inverse_dynamics(config.model, y[Signal.POSITION], scratch[0], state.accelerations, scratch[1:3])
    add_offset(config, scratch[1:3], 1.0)
    for j in range(scratch.shape[1]):
        effort = scratch[2, j] if config.uses_model else state.hold[Hold.LEARNT, j]
        effort += learnt_effort(config, state, j)
        learnt, most = effort - scratch[1, j], _LARGEST_SHARE * config.limits.effort[j]
        state.hold[Hold.LEARNT, j] = min(max(learnt, -most), most) if math.isfinite(learnt) else 0.0


@part
def begin_hold(config: ControllerConfig, state: ControllerState, stamp: int) -> None:
    """Start a desired motion from the present motion of the arm to rest, and weigh the arm."""
    conditions = state.conditions
    if conditions[Condition.HELD] == Held.NOT:
        learn(config, state)
        _doubt_what_was_learnt(config, state, stamp)
    fastest = 0.0
    for j in range(state.measured.size):
        position, velocity = _present_motion(config, state, stamp, j)
        fastest = max(fastest, abs(velocity))
        if conditions[Condition.HELD] == Held.NOT:
            state.hold[Hold.BEFORE, j] = velocity
            state.hold[Hold.WEIGHED, j] = state.hold[Hold.DAMPED, j] = state.hold[Hold.DROPPED, j] = 0.0
        state.hold[Hold.VELOCITY, j] = velocity
        state.hold[Hold.POSITION, j] = position
        state.desired[0, j] = position
        state.desired[1, j] = velocity
        state.desired[2, j] = 0.0
    continues, suspended = time_of_change(state) > _LONG_CHANGE, conditions[Condition.UNLIMITED]
    if continues:
        _continue_acceleration(config, state, stamp)
    state.hold_pace[0] = min(max(_FADES_OVER / max(fastest, 1e-9), QUICKEST), SLOWEST)
    _plan_stop(config, state, stamp, fastest)
    if continues and state.approach_duration[0] > _LONGEST_REST:
        conditions[Condition.UNLIMITED] = suspended
        _plan_shorter(config, state, stamp, fastest)
    _weigh(config, state)
    _choose_bandwidth(config, state)
    state.conditions[Condition.HELD] = Held.HERE
    state.status[Status.STOP_STAGE] = Stop.HOLD


@part
def resume_hold(config: ControllerConfig, state: ControllerState, stamp: int) -> bool:
    """Hold an arm that was not seen for a while where it was held before; return whether it is near enough.

    With a new place after each of several gaps, it would go astray. After a long one, it is not pulled back.
    """
    if state.times[Time.GAP] > _LONG_GAP:
        return False
    for j in range(state.measured.size):
        position, _ = _present_motion(config, state, stamp, j)
        if not abs(position - state.desired[0, j]) < _NEAR:
            return False
    for j in range(state.measured.size):
        state.hold[Hold.POSITION, j], state.hold[Hold.VELOCITY, j] = _present_motion(config, state, stamp, j)
    state.conditions[Condition.HELD] = Held.HERE
    state.status[Status.STOP_STAGE] = Stop.HOLD
    return True


@inlined
def _continue_acceleration(config: ControllerConfig, state: ControllerState, stamp: int) -> None:
    """Begin the way to rest with the acceleration that the last command causes, because it cannot change at once.

    What was applied without effect so far, such as against friction, does not accelerate the arm now.
    """
    _find_load(config, state, stamp)
    for j in range(state.sent.size):
        state.motion[0, j] = 0.0
    inverse_dynamics(config.model, state.desired[0], state.desired[1], state.motion[:1], state.scratch[3:4])
    add_offset(config, state.scratch[3:4], 1.0)
    enough = state.counts[Count.NOTES] >= RECENT
    for j in range(state.sent.size):
        state.net[j] = net = state.sent[j] - state.hold[Hold.LEARNT, j]
        if enough and not is_doubtful(state, j):
            carried = state.scratch[3, j]
            state.net[j] = carried + _middle(net - carried, state.sent[j] - state.scratch[2, j] - carried, 0.0)
    for j in range(state.sent.size):
        state.scratch[0, j] = state.desired[0, j]
        state.scratch[1, j] = state.desired[1, j]
    add_offset(config, state.net.reshape((1, -1)), -1.0)
    forward_dynamics(config.model, state.scratch[0], state.scratch[1], state.net, state.desired[2])


@inlined
def _choose_bandwidth(config: ControllerConfig, state: ControllerState) -> None:
    """Choose the bandwidth of the hold: that of the configuration, or what its drives and torque limits allow."""
    bandwidth, slowest = config.stop.bandwidth, time_of_change(state)
    if slowest > 0.0:
        bandwidth = min(bandwidth, _OF_CHANGE / slowest)
    late = remaining(config, state)
    if late > 0.0:
        bandwidth = min(bandwidth, _OF_LATENESS / late)
    for j in range(state.measured.size):
        stiffness = _SHARE_OF_LIMIT * config.limits.effort[j] / _AWAY
        if state.inertia[j, j] > 0.0:
            bandwidth = min(bandwidth, math.sqrt(stiffness / (3.0 * state.inertia[j, j])))
    state.hold_bandwidth[0] = bandwidth


@part
def _plan_stop(config: ControllerConfig, state: ControllerState, stamp: int, fastest: float) -> None:
    """Plan the way to rest for an arm of which the fastest joint has this speed (rad/s).

    It keeps the rate limit if the arm then goes only little farther; otherwise the limit is suspended.
    """
    conditions, shortest = (
        state.conditions,
        min(max(2.0 * _WAY_TO_REST / max(fastest, 1e-9), _SHORTEST_REST), _LONGEST_REST),
    )
    suspended = conditions[Condition.UNLIMITED]
    conditions[Condition.UNLIMITED] = 1
    come_to_rest(config, state, stamp, shortest)
    if config.rate_limited and suspended == 0:
        unlimited = state.approach_duration[0]
        conditions[Condition.UNLIMITED] = 0
        come_to_rest(config, state, stamp, shortest)
        if 0.5 * fastest * (state.approach_duration[0] - unlimited) > DETOUR:
            conditions[Condition.UNLIMITED] = 1
            come_to_rest(config, state, stamp, shortest)


@part
def _plan_shorter(config: ControllerConfig, state: ControllerState, stamp: int, fastest: float) -> None:
    """Plan without the acceleration with which the way begins, if it is shorter then.

    The longer a way takes, the farther its first acceleration leads. If the way begins without it, the effort needs
    some time to follow, in which the arm goes astray.
    """
    far, farther, astray = 0.0, 0.0, 0.25 * time_of_change(state) ** 2
    suspended = state.conditions[Condition.UNLIMITED]
    for j in range(state.measured.size):
        far = max(far, abs(state.held[0, j] - state.desired[0, j]))
        state.net[j] = state.desired[2, j]
        state.desired[2, j] = 0.0
    _plan_stop(config, state, stamp, fastest)
    for j in range(state.measured.size):
        way = abs(state.held[0, j] - state.desired[0, j])
        farther = max(farther, way + astray * abs(state.net[j]))
    if farther > far:
        state.conditions[Condition.UNLIMITED] = suspended
        for j in range(state.measured.size):
            state.desired[2, j] = state.net[j]
        _plan_stop(config, state, stamp, fastest)


@inlined
def _middle(a: float, b: float, c: float) -> float:
    """The median of three numbers: one of them may be arbitrarily wrong."""
    return max(min(a, b), min(max(a, b), c))


@part
def _present_motion(config: ControllerConfig, state: ControllerState, stamp: int, joint: int) -> tuple[float, float]:
    """Position (rad) and velocity (rad/s) of a joint at `stamp` (ns), of which no single measurement decides.

    The velocity is the median of the estimated one, of that of the last measurements, and of that of more of them. If
    the joint is not trusted, its estimates are not, either; once it is held, what the hold uses counts.
    """
    y, hold = state.signals, state.hold
    if is_doubtful(state, joint) and state.conditions[Condition.HELD] != Held.NOT:
        return hold[Hold.POSITION, joint], hold[Hold.VELOCITY, joint]
    recent, velocity = noted_motion(state, stamp, joint, RECENT)
    _, before = noted_motion(state, stamp, joint, HISTORY)
    if state.counts[Count.NOTES] < 2:
        velocity = 0.0  # The controller has just begun, at rest; a few samples show no velocity.
    elif is_doubtful(state, joint):
        velocity = before
    else:
        recent = _middle(state.measured[joint], recent, y[Signal.POSITION, joint])
        velocity = _middle(y[Signal.VELOCITY, joint], velocity, before)
    most = config.plausible_velocity[joint] if config.plausible_velocity[joint] > 0.0 else math.inf
    if config.limits.velocity[joint] > 0.0:
        most = min(most, _LARGEST_VELOCITY * config.limits.velocity[joint])
    return recent, min(max(velocity, -most), most)


@inlined
def _doubt_what_was_learnt(config: ControllerConfig, state: ControllerState, stamp: int) -> None:
    """Of what the law has learnt, believe what the motion of the arm confirms: its output may be part of the fault.

    The median of it, of the effort that acts on the arm from outside (see contact.py), and of what the noted efforts
    were beyond those that the noted motion needs. In contact, which is no load to carry, what acted from outside when
    the arm was last near its reference takes the place of the latter. If efforts have had no effect, those count that
    were applied before.
    """
    if state.status[Status.FAULT] == Fault.NO_EFFECT:
        carry(config, state, state.measured)
        for j in range(state.measured.size):
            if state.hold[Hold.DISTRUSTED, j] != 0.0:
                state.hold[Hold.LEARNT, j] = state.still[Still.EFFORT, j] - state.signals[Signal.EFFORT, j]
        return
    external, learnt = state.external, state.hold[Hold.LEARNT]
    _find_load(config, state, stamp)
    touches = state.status[Status.FAULT] == Fault.EXTERNAL_EFFORT_LIMIT or in_contact(config, state)
    enough = state.counts[Count.NOTES] >= RECENT
    for j in range(state.measured.size):
        noted = state.scratch[2, j] if enough else 0.0
        if not config.senses_contact:
            learnt[j] = _middle(learnt[j], noted, 0.0)
        elif touches:
            learnt[j] = _middle(learnt[j], -external[External.TWICE, j], -external[External.USUAL, j])
        else:
            learnt[j] = _middle(learnt[j], -external[External.TWICE, j], noted)


@part
def _find_load(config: ControllerConfig, state: ControllerState, stamp: int) -> None:
    """Write what was applied beyond what the noted motion needs, by the model, to ``state.scratch[2]``, N m."""
    motion, velocities = state.motion, state.scratch[0]
    for j in range(state.measured.size):
        _, velocities[j] = noted_motion(state, stamp, j, RECENT)
        motion[0, j] = noted_acceleration(state, stamp, j)
    inverse_dynamics(config.model, state.measured, velocities, motion[:1], state.scratch[2:3])
    add_offset(config, state.scratch[2:3], 1.0)
    for j in range(state.measured.size):
        state.scratch[2, j] = noted_effort(state, stamp, j) - state.scratch[2, j]


@part
def _weigh(config: ControllerConfig, state: ControllerState) -> None:
    """Write the inertia of the model where the arm is to ``state.inertia``."""
    joints = state.measured.size
    still, efforts = state.accelerations, state.scratch[1:3]
    for k in range(joints):
        for j in range(joints):
            still[0, j] = still[1, j] = state.scratch[0, j] = 0.0
        still[1, k] = 1.0
        inverse_dynamics(config.model, state.hold[Hold.POSITION], state.scratch[0], still, efforts)
        for j in range(joints):
            state.inertia[j, k] = efforts[1, j] - efforts[0, j]


@inlined
def forget_law(state: ControllerState) -> None:
    """Let a law of the whole arm begin afresh."""
    for k in range(state.law_memory.size):
        state.law_memory[k] = 0.0


@part
def keep_what_holds(config: ControllerConfig, state: ControllerState) -> None:
    """Let the law start with what holds the arm: with what it has learnt if that is nearer to it than nothing.

    Its state is part of some faults, such as an error that has wound up an integral.
    """
    w, scratch, held = state.hold_bandwidth[0], state.scratch, state.scratch[5]
    for j in range(held.size):
        held[j] = state.hold[Hold.LEARNT, j]
        for k in range(held.size):
            held[j] -= w * w * w * state.inertia[j, k] * state.hold[Hold.INTEGRAL, k]
    learn(config, state)
    for j in range(held.size):
        learnt = state.hold[Hold.LEARNT, j]
        absurd = abs(learnt) >= _LARGEST_SHARE * config.limits.effort[j]
        if absurd or abs(scratch[5, j] - learnt) > abs(scratch[5, j]):
            for slot in range(state.law.shape[1]):
                state.law[j, slot] = 0.0
            forget_law(state)
