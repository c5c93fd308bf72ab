"""The desired motion that the law follows: the reference or a held position, plus an approach.

The approach is a quintic that begins at the difference from the current motion and ends at zero, so the desired motion
makes no step. If a rate limit has thrown the arm off its reference, the approach brakes first: its sum with another
quintic, which takes velocity and acceleration away as soon as the limits allow, so that the arm goes no farther than it
must. Along the approach, the effort that is fed forward fades to that of the reference, or to zero in a held position.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.compliance import add_offset_of
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.effort import time_of_change, write_net_effort
from pidtsm_core.control.learnt_demand import demand_without_error, learnt_acceleration, learnt_effort
from pidtsm_core.control.state import Condition, ControllerState, Count, Time, part
from pidtsm_core.control.turns import turn_reference
from pidtsm_core.references import extrapolate
from pidtsm_core.references.polynomials import add_quintic, quintic
from pidtsm_core.robots import forward_dynamics, inverse_dynamics
from pidtsm_core.signals import Adaptation, Mode, Request, Signal, Status
from pidtsm_core.timing import seconds

_SHARE_OF_RATE = 0.5
"""Share of the rate limit that an approach may use; the rest is for the law."""
_SHARE_OF_EFFORT = 0.9
_SHARE_OF_VELOCITY, _LEAST_SHARE = 0.8, 0.1
"""Share of a velocity limit that reference and approach may use together, and what the approach may use in any case."""
_STEEPEST = 1.875
"""Largest velocity of a quintic from rest to rest, as a multiple of the mean."""
_SHORTEST_APPROACH, _LONGEST_APPROACH, _LONGER = 0.01, 20.0, 1.2  # s, s, ratio of consecutive durations tried
_SHORTEST_REST, _LONGEST_REST = 0.1, 2.0  # s in which the desired motion comes to rest
_REST_BY_HAND = 0.3  # s, the shortest time in which it does so at the end of freedrive
_MOMENTS = 12
_FOR_RETURN = 1.2
"""Excess of braking and return together, relative to that of braking alone, that is small enough."""
_HOPELESS = 2.0
"""Excess (see `_excess`) at which an approach is useless: its rate needs the whole limit, not only its share."""
_ABSURD = 1e4  # rad/s^2; a larger correction comes from a singular law


@inlined
def choose(config: ControllerConfig, state: ControllerState, stamp: int, reference_stamp: int) -> None:
    """Choose between the reference and a held position, and write the desired motion at the sample.

    A reference is followed while its age, or its time ahead, is at most ``watchdog.reference``. Once the controller
    holds a position, it follows a reference of at most half that age. Otherwise references that are late by about the
    limit would make it switch back and forth. On request, it holds a position in any case, or lets a person move the
    arm; then the desired motion is that of the arm.

    Args:
        config: configuration, which is read.
        state: state, which is changed.
        stamp: stamp of the sample, ns.
        reference_stamp: stamp of ``state.reference``, ns; negative: there is none.
    """
    counts, conditions, times, status = state.counts, state.conditions, state.times, state.status
    followed = counts[Count.ANSWERED] > 0 and status[Status.MODE] == Mode.FOLLOWING
    stopped = status[Status.FAULT] != 0
    age = stamp - reference_stamp
    oldest = config.watchdog.reference if followed else config.watchdog.reference // 2
    wanted = conditions[Condition.REQUEST] == Request.FOLLOW
    follows = wanted and reference_stamp >= 0 and abs(age) <= oldest and not stopped
    free = conditions[Condition.REQUEST] == Request.FREE and not stopped
    freed = times[Time.FREED] != 0 and not stopped and not free
    status[Status.MODE] = Mode.STOPPED if stopped else (Mode.FOLLOWING if follows else Mode.HOLDING)
    if stopped:
        times[Time.FREED] = 0
    times[Time.REFERENCE_AGE] = age if reference_stamp >= 0 else 0
    if follows and config.turns:
        turn_reference(config, state, followed)
    if free:
        status[Status.MODE] = Mode.FREEDRIVE
        _let_go(state)
        return
    if follows and not followed:
        # Start at the last desired motion; at the first sample, this is rest at the position of the arm.
        _begin_approach(config, state, stamp, False)
        conditions[Condition.ADAPTATION] = (
            Adaptation.APPROACHING if state.approach_duration[0] > 0.0 else Adaptation.NORMAL
        )
        conditions[Condition.STRAYED] = 0
    elif (followed or freed) and not follows:
        come_to_rest(config, state, stamp, _REST_BY_HAND if freed else _SHORTEST_REST)
    write_desired(state, stamp)


@inlined
def write_desired(state: ControllerState, stamp: int) -> None:
    """Write the reference or the held position, plus the approach, at `stamp` (ns) to ``state.desired``."""
    write_base(state, state.desired)
    duration, passed = state.approach_duration[0], 1.0
    if duration > 0.0:
        t = seconds(stamp - state.times[Time.APPROACH_BEGAN])
        if t < duration:
            _add_approach(state, duration, t)
            passed = t / duration
        else:
            _end_approach(state)
    follows = state.status[Status.MODE] == Mode.FOLLOWING
    if follows and state.approach_duration[0] == 0.0:
        state.conditions[Condition.GENTLE] = 0
    for j in range(state.feedforward_effort.size):
        state.feedforward_effort[j] = _feedforward(state, j, passed)
        state.freedrive_effort[j] = state.freedrive_before[j] * (_left(passed) if follows else 1.0)


@part
def _add_approach(state: ControllerState, duration: float, t: float) -> None:
    """Add the approach, which takes `duration` (s), at t (s) to the desired motion."""
    add_quintic(state.approach, duration, t, state.desired)
    if t < state.braking_duration[0]:
        add_quintic(state.braking, state.braking_duration[0], t, state.desired)


@part
def _let_go(state: ControllerState) -> None:
    """Make the arm's own motion the desired one."""
    begin_at(state, state.measured)
    for j in range(state.measured.size):
        state.desired[1, j] = state.signals[Signal.VELOCITY, j]


@part
def begin_at(state: ControllerState, position: Array) -> None:
    """Set the desired motion to rest at `position`, shape (joints,), rad."""
    _end_approach(state)
    for j in range(position.size):
        state.feedforward_effort[j] = state.freedrive_effort[j] = state.freedrive_before[j] = 0.0
        state.held[0, j] = position[j]
        state.held[1, j] = 0.0
        state.held[2, j] = 0.0
        for i in range(3):
            state.desired[i, j] = state.held[i, j]


@part
def come_to_rest(config: ControllerConfig, state: ControllerState, stamp: int, duration: float) -> None:
    """Bring the desired motion to rest in `duration` (s) or longer, with no step of position, velocity or acceleration.

    The end position is that of a quartic with the same other conditions, so the motion need not turn back or speed up.
    """
    _end_approach(state)
    start = state.scratch[3:]
    for i in range(3):
        for j in range(start.shape[1]):
            start[i, j] = state.desired[i, j]
    _plan_rest(state, start, duration)
    while duration < _LONGEST_REST and _excess(config, state, duration, duration) > 1.0:
        duration *= _LONGER
        _plan_rest(state, start, duration)
    state.approach_duration[0] = duration
    state.times[Time.APPROACH_BEGAN] = stamp
    for i in range(3):
        for j in range(start.shape[1]):
            state.desired[i, j] = start[i, j]


@inlined
def _plan_rest(state: ControllerState, start: Array, duration: float) -> None:
    """Plan a stop from `start` (q, q', q'', shape (3, joints)) in `duration` (s): its end position and the approach."""
    for j in range(start.shape[1]):
        state.held[0, j] = _resting_place(start, duration, j)
        for i in range(1, 3):
            state.held[i, j] = 0.0
        for i in range(3):
            state.base[i, j] = state.held[i, j]
        state.feedforward_before[j] = state.feedforward_effort[j]
        state.freedrive_before[j] = state.freedrive_effort[j]
    quintic(start, state.held, duration, state.approach)
    # The approach is the difference from the held position.
    for j in range(start.shape[1]):
        state.approach[0, j] -= state.held[0, j]


@inlined
def _resting_place(start: Array, duration: float, joint: int) -> float:
    """Where a joint comes to rest, rad: the end of a quartic from `start` (q, q', q'', shape (3, joints)) to rest."""
    return start[0, joint] + duration * (0.5 * start[1, joint] + duration * start[2, joint] / 12.0)


@inlined
def write_base(state: ControllerState, motion: Array) -> None:
    """Write the reference at the sample, or the held position, to `motion`, shape (3, joints)."""
    follows, age = state.status[Status.MODE] == Mode.FOLLOWING, state.times[Time.REFERENCE_AGE]
    if follows and age:
        extrapolate(state.reference, seconds(age), motion)
    else:
        source = state.reference if follows else state.held
        for i in range(3):
            for j in range(motion.shape[1]):
                motion[i, j] = source[i, j]
    for j in range(motion.shape[1]):
        motion[0, j] += state.turned[j] if follows else 0.0
    if follows:
        add_offset_of(state, motion)


@inlined
def _left(passed: float) -> float:
    """What is left of an effort that fades, from 1 to 0, when a share `passed` (0 to 1) of the approach has passed."""
    return 1.0 - passed * passed * passed * (10.0 - passed * (15.0 - 6.0 * passed))


@inlined
def _feedforward(state: ControllerState, joint: int, passed: float) -> float:
    """Effort of the reference to add to the command, N m, when a share `passed` (0 to 1) of the approach has passed."""
    target = state.feedforward[joint] if state.status[Status.MODE] == Mode.FOLLOWING else 0.0
    return target + _left(passed) * (state.feedforward_before[joint] - target)


@inlined
def _end_approach(state: ControllerState) -> None:
    state.approach_duration[0] = state.braking_duration[0] = 0.0
    state.conditions[Condition.ADAPTATION] = Adaptation.NORMAL
    state.conditions[Condition.STRAYED] = 0


@part
def _begin_approach(config: ControllerConfig, state: ControllerState, stamp: int, brakes: bool) -> float:
    """Plan the approach from the motion in ``state.desired`` to the reference or the held position.

    Args:
        config: configuration, which is read.
        state: state, which is changed.
        stamp: stamp of the sample, ns.
        brakes: whether the approach brakes first.

    Returns:
        The `_excess` of the approach; 0 if no rate is limited.
    """
    start, difference, rest = state.desired, state.scratch[:3], state.scratch[3:]
    state.braking_duration[0] = 0.0
    write_base(state, state.base)
    for i in range(3):
        for j in range(start.shape[1]):
            difference[i, j] = start[i, j] - state.base[i, j]
            rest[i, j] = 0.0
    for j in range(start.shape[1]):
        state.feedforward_before[j] = state.feedforward_effort[j]
        state.freedrive_before[j] = state.freedrive_effort[j]
    excess = _plan_braking(config, state) if brakes else 0.0
    duration = max(_slow_enough(config, state, difference), state.braking_duration[0])
    if config.rate_limited:
        duration, excess = _duration(config, state, duration, max(_FOR_RETURN * excess, 1.0))
    if duration > 0.0:
        quintic(difference, rest, duration, state.approach)
    state.approach_duration[0] = duration
    state.times[Time.APPROACH_BEGAN] = stamp
    return excess


@part
def _plan_braking(config: ControllerConfig, state: ControllerState) -> float:
    """Plan to brake in the shortest time with an `_excess` of at most 1, or of what the effort is now; else the least.

    ``state.scratch`` has the difference with which the approach begins, then zeros. Afterwards, it has the difference
    that remains when the arm has braked.

    Returns:
        The excess.
    """
    difference, rest = state.scratch[:3], state.scratch[3:]
    duration = best = _SHORTEST_APPROACH
    least, enough = math.inf, 1.0
    for j in range(difference.shape[1]):
        enough = max(enough, abs(state.signals[Signal.EFFORT, j]) / (_SHARE_OF_EFFORT * config.limits.effort[j]))
    while duration < _LONGEST_REST and least > enough:
        _brake(state, duration)
        excess = _excess(config, state, duration, duration)
        if excess < least:
            best, least = duration, excess
        duration *= _LONGER
    _brake(state, best)
    for j in range(difference.shape[1]):
        difference[0, j] = state.approach[0, j]
        difference[1, j] = difference[2, j] = rest[0, j] = 0.0
    return least


@inlined
def _brake(state: ControllerState, duration: float) -> None:
    """Brake in `duration` (s), and stay: the approach is the difference that remains."""
    difference, rest = state.scratch[:3], state.scratch[3:]
    for j in range(difference.shape[1]):
        rest[0, j] = _resting_place(difference, duration, j)
    quintic(difference, rest, duration, state.braking)
    quintic(rest, rest, duration, state.approach)
    for j in range(difference.shape[1]):
        state.braking[0, j] -= rest[0, j]
    state.braking_duration[0] = duration


@inlined
def _slow_enough(config: ControllerConfig, state: ControllerState, difference: Array) -> float:
    """Duration of the approach, s: ``activation.blend``, or longer so that it keeps within the velocity limits.

    Args:
        config: configuration, which is read.
        state: state; the velocity of ``state.base`` leaves less for the approach.
        difference: what the approach begins with, shape (3, joints).
    """
    gentle = state.conditions[Condition.GENTLE] != 0
    duration = max(config.activation.blend, _SHORTEST_REST) if gentle else config.activation.blend
    for j in range(difference.shape[1]):
        limit = config.freedrive.velocity[j] if gentle else config.limits.velocity[j]
        if duration > 0.0 and limit > 0.0:
            free = max(_SHARE_OF_VELOCITY * limit - abs(state.base[1, j]), _LEAST_SHARE * limit)
            duration = max(duration, min(_STEEPEST * abs(difference[0, j]) / free, _LONGEST_APPROACH))
    return duration


@part
def _duration(config: ControllerConfig, state: ControllerState, shortest: float, most: float) -> tuple[float, float]:
    """Duration of the approach, at least `shortest` (s), and its `_excess`: at most `most`, or else the least there is.

    ``state.scratch`` has the difference with which the approach begins, then that with which it ends.
    """
    difference, rest = state.scratch[:3], state.scratch[3:]
    duration = best = max(shortest, _SHORTEST_APPROACH)
    least = math.inf
    while duration < _LONGEST_APPROACH:
        quintic(difference, rest, duration, state.approach)
        excess = _excess(config, state, duration, duration)
        if state.braking_duration[0] > 0.0:
            excess = max(excess, _excess(config, state, duration, state.braking_duration[0]))
        if excess < least:
            best, least = duration, excess
        if excess <= most:
            break
        duration *= _LONGER
    return best, least


@inlined
def _excess(config: ControllerConfig, state: ControllerState, duration: float, until: float) -> float:
    """The largest effort or effort rate along an approach, by the model, as a multiple of what the approach may use.

    It is evaluated at some moments up to `until` (s), assuming that the base keeps its velocity.
    """
    motion, efforts = state.desired, state.accelerations
    step, excess = until / _MOMENTS, 0.0
    slowest = time_of_change(state)
    for k in range(_MOMENTS + 1):
        t = k * step
        for j in range(motion.shape[1]):
            motion[0, j] = state.base[0, j] + t * state.base[1, j]
            motion[1, j] = state.base[1, j]
            motion[2, j] = 0.0
            efforts[1, j] = efforts[0, j]
        _add_approach(state, duration, t)
        inverse_dynamics(config.model, motion[0], motion[1], motion[2:], efforts[:1])
        for j in range(motion.shape[1]):
            efforts[0, j] += _feedforward(state, j, t / duration)
            excess = max(excess, abs(efforts[0, j]) / (_SHARE_OF_EFFORT * config.limits.effort[j]) if k else 0.0)
            rate = abs(efforts[0, j] - efforts[1, j]) / step if k else 0.0
            if config.limits.effort_rate[j] > 0.0 and state.conditions[Condition.UNLIMITED] == 0:
                excess = max(excess, rate / (_SHARE_OF_RATE * config.limits.effort_rate[j]))
            if state.status[Status.FAULT] != 0:
                excess = max(excess, rate * slowest / config.limits.effort[j])
    return excess


@part
def begin_approach_here(config: ControllerConfig, state: ControllerState, stamp: int) -> bool:
    """Begin an approach at the arm's estimated motion, with the acceleration that keeps the present effort.

    It brakes first. A single quintic would be as long for braking as for the return, and the arm would go far astray.

    This is the acceleration that the effort causes by the model, minus the output of the law without errors, which is
    what the law has learnt of the disturbances. So neither the desired motion nor the effort makes a step.

    Returns:
        Whether the approach is within the limits, or nearly so.
    """
    y, start = state.signals, state.desired
    write_net_effort(state, y[Signal.EFFORT])
    if config.law.of_arm:
        demand_without_error(config, state)
        for j in range(state.net.size):
            state.net[j] -= learnt_effort(config, state, j)
    forward_dynamics(config.model, y[Signal.POSITION], y[Signal.VELOCITY], state.net, start[2])
    for j in range(state.measured.size):
        start[0, j] = y[Signal.POSITION, j]
        start[1, j] = y[Signal.VELOCITY, j]
        learnt = learnt_acceleration(config, state, j)
        if abs(learnt) < _ABSURD:
            start[2, j] -= learnt
    excess = _begin_approach(config, state, stamp, True)
    write_base(state, state.desired)
    _add_approach(state, state.approach_duration[0], 0.0)
    if state.conditions[Condition.ADAPTATION] == Adaptation.NORMAL:
        state.conditions[Condition.STRAYED] = 1
    state.conditions[Condition.ADAPTATION] = Adaptation.FROZEN
    return excess < _HOPELESS
