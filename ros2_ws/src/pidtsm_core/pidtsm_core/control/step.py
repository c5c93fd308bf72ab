"""The step of the controller: everything between a measured position and the commanded effort."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined, njit
from pidtsm_core.control.barrier import keep_inside
from pidtsm_core.control.compliance import yield_to_contact
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.desired import begin_approach_here, begin_at, choose, write_base
from pidtsm_core.control.effect import distrust_idle, watch_effect
from pidtsm_core.control.effort import carry, limit_rate, rate_delay, write_command
from pidtsm_core.control.freedrive import hand_over, make_free
from pidtsm_core.control.handover import begin_handover, fade_handover
from pidtsm_core.control.history import note
from pidtsm_core.control.lateness import LATEST_FOR_FREEDRIVE, remaining
from pidtsm_core.control.modes import hold_elsewhere, hold_unseen, request, reset_fault, stop
from pidtsm_core.control.plausibility import doubt
from pidtsm_core.control.safe import leave, make_safe, make_safe_blindly
from pidtsm_core.control.state import (
    Condition,
    ControllerMemory,
    ControllerState,
    Count,
    External,
    Handover,
    Time,
    memory_at,
    part,
)
from pidtsm_core.control.tick import tick
from pidtsm_core.control.turns import distance, unwind_measurement
from pidtsm_core.signals import Fault, Limited, Mode, Request, Signal, Status, Violation
from pidtsm_core.timing import NANOSECONDS, seconds, track_period

_BEHIND = 0.02
"""s; if a rate limit delays the effort longer, the arm takes another approach."""
_BEHIND_IN_STOP = 0.01
"""s; likewise, while the arm is stopped: then the limit is suspended."""
_LONGEST_BEHIND_IN_STOP = NANOSECONDS // 20
"""ns; if the delay persists longer, unless the arm is held."""
_BEYOND_RANGE, _BEYOND_AT_MOST = 0.01, 0.01
"""How far a joint may be beyond its position limits: a share of its range, and rad or m. A motion may end at a limit,
and there the noise of the encoder or the smallest overshoot must not stop the arm."""
_PERIODS_TO_HOLD, _PERIODS_TO_STOP = 2, 5
"""Nominal periods up to which a gap between joint states is never late, and never a fault."""
_LONGEST_BEHIND = NANOSECONDS // 2
"""ns; if the delay persists longer, the limit is too tight for the arm: a fault, which suspends the limit."""


@part
def step(config: ControllerConfig, state: ControllerState, stamp: int, reference_stamp: int) -> None:
    """Respond to the joint state in ``state.measured``; the result is in ``state.signals`` and ``state.status``.

    Args:
        config: configuration, which is read.
        state: state, which is changed.
        stamp: stamp of the joint state, ns, later than the last one.
        reference_stamp: stamp of the reference in ``state.reference``, ns; negative: there is none.
    """
    counts, times, conditions = state.counts, state.times, state.conditions
    if config.rehearses:
        _rehearse(config, state, stamp, reference_stamp)
    first = counts[Count.ANSWERED] == 0
    period = 0 if first else stamp - times[Time.LAST]
    dt = seconds(period)
    times[Time.GAP] = period
    times[Time.SILENT_SINCE] = 0
    if first:
        _begin(config, state)
        note(state, stamp)
    else:
        _receive(config, state, stamp, period)
    if conditions[Condition.HANDOVER] == Handover.PENDING:
        begin_handover(config, state, dt)
    elif conditions[Condition.HANDOVER] == Handover.FADING:
        fade_handover(config, state, dt)
    yield_to_contact(config, state, dt)
    choose(config, state, stamp, reference_stamp)

    tick(config, state, dt)
    if times[Time.FREED] != 0 and state.status[Status.MODE] != Mode.FREEDRIVE:
        hand_over(state)
    # A limit that was removed is no longer exceeded.
    state.status[Status.VIOLATIONS] = 0
    if config.watches:
        _check_limits(config, state)
    if state.status[Status.FAULT]:
        make_safe(config, state, stamp, dt)
    elif state.status[Status.MODE] == Mode.FREEDRIVE:
        make_free(config, state, stamp, dt)
    if config.keeps_inside and not state.status[Status.FAULT]:
        keep_inside(config, state)
    if config.rate_limited:
        since = 0 if first else max(stamp - times[Time.SENT], 0)
        _limit_rate(config, state, stamp, seconds(since))
    _count(state)
    write_command(config, state, dt)
    times[Time.LAST] = stamp
    times[Time.SENT] = stamp
    counts[Count.ANSWERED] += 1
    conditions[Condition.COMMANDED] = 1


@part
def _begin(config: ControllerConfig, state: ControllerState) -> None:
    """Begin at rest where the arm is; a rate limit starts from the effort that carries it."""
    begin_at(state, state.measured)
    if config.rate_limited and state.conditions[Condition.COMMANDED] == 0:
        carry(config, state, state.measured)
        for j in range(state.sent.size):
            state.sent[j] = state.signals[Signal.EFFORT, j]


@inlined
def _receive(config: ControllerConfig, state: ControllerState, stamp: int, period: int) -> None:
    """Judge the joint state of `stamp` (ns), `period` (ns) after the last one, and note it if it is plausible."""
    implausible = state.counts[Count.IMPLAUSIBLE]
    if config.turns:
        unwind_measurement(config, state)
    _watch_gaps(config, state, period)
    if config.checks_plausibility:
        _doubt(config, state, seconds(period))
    idle = watch_effect(config, state)
    if idle:
        _distrust_idle(config, state, idle)
    if state.counts[Count.IMPLAUSIBLE] == implausible:
        note(state, stamp)


@inlined
def stop_after(state_stop: int, period: int) -> int:
    """Longest gap between joint states that is no fault: ``watchdog.state_stop`` or some periods; all in ns."""
    return max(state_stop, _PERIODS_TO_STOP * period)


@inlined
def _watch_gaps(config: ControllerConfig, state: ControllerState, period: int) -> None:
    """Count a joint state that is late, `period` (ns) after the last one, and stop if the gap was too long."""
    times, counts = state.times, state.counts
    if period > max(config.watchdog.state_hold, _PERIODS_TO_HOLD * times[Time.PERIOD]):
        counts[Count.LATE] += 1
    if period > stop_after(config.watchdog.state_stop, times[Time.PERIOD]):
        stop(state, Fault.STATE_STALE, 0)
        hold_unseen(state)
    times[Time.PERIOD] = track_period(times[Time.PERIOD], period)


@inlined
def _doubt(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Stop if a joint has too many implausible measurements, and restart the estimates from them."""
    joint = doubt(config, state, dt)
    if joint:
        stop(state, Fault.MEASUREMENT, joint)
        _believe(state)


@part
def _distrust_idle(config: ControllerConfig, state: ControllerState, joint: int) -> None:
    """Stop because the effort has no effect on a joint (counted from 1)."""
    stop(state, Fault.NO_EFFECT, joint)
    distrust_idle(config, state)


@part
def _believe(state: ControllerState) -> None:
    """Restart the estimates from the measurements."""
    for j in range(state.estimator.shape[0]):
        for slot in range(state.estimator.shape[1]):
            state.estimator[j, slot] = 0.0
    hold_elsewhere(state)


@inlined
def _count(state: ControllerState) -> None:
    """Count the step if an effort is at a limit."""
    limited = 0
    for j in range(state.measured.size):
        limited |= int(state.signals[Signal.SATURATED, j])
    if limited:
        state.counts[Count.AT_EFFORT_LIMIT] += limited & Limited.EFFORT != 0
        state.counts[Count.AT_RATE_LIMIT] += limited & Limited.RATE != 0


@part
def _distance(config: ControllerConfig, state: ControllerState) -> float:
    """Largest distance of a joint from its reference, rad."""
    largest = 0.0
    for j in range(state.measured.size):
        largest = max(largest, distance(config.turn, state.reference[0], state.measured, j))
    return largest


@part
def _rehearse(config: ControllerConfig, state: ControllerState, stamp: int, reference_stamp: int) -> None:
    """Record when the controller began; reset or restart it if the parameters ``rehearsal`` demand it now."""
    times, conditions = state.times, state.conditions
    if times[Time.BEGAN] == 0 or stamp < times[Time.BEGAN] - 1:
        times[Time.BEGAN] = stamp + 1
    age = stamp + 1 - times[Time.BEGAN]
    resets = (
        0 < config.rehearsal.reset_fault <= age
        and conditions[Condition.REHEARSED_RESET] == 0
        and state.status[Status.FAULT] != 0
    )
    stays = reference_stamp < 0 or conditions[Condition.REQUEST] != Request.FOLLOW
    if resets and (stays or _distance(config, state) <= config.activation.distance):
        conditions[Condition.REHEARSED_RESET] = 1
        reset_fault(config, state)
    _rehearse_requests(config, state, age)
    if 0 < config.rehearsal.restart <= age and conditions[Condition.REHEARSED_RESTART] == 0:
        conditions[Condition.REHEARSED_RESTART] = 1
        conditions[Condition.COMMANDED] = 0
        reset_fault(config, state)


@inlined
def _rehearse_requests(config: ControllerConfig, state: ControllerState, age: int) -> None:
    """Make the requests whose time has come since the last joint state; `age` is that of the controller, ns."""
    last = max(state.times[Time.LAST] + 1 - state.times[Time.BEGAN], 0)  # Time 0 means never.
    if last < config.rehearsal.freedrive <= age and state.status[Status.FAULT] == 0 and _can_be_free(config, state):
        request(state, Request.FREE)
    if last < config.rehearsal.hold <= age:
        request(state, Request.HOLD)
    if last < config.rehearsal.follow <= age and _distance(config, state) <= config.activation.distance:
        request(state, Request.FOLLOW)


@inlined
def _can_be_free(config: ControllerConfig, state: ControllerState) -> bool:
    """Whether the controller could let a person move the arm, see `Controller.request`."""
    return config.uses_model and remaining(config, state) <= LATEST_FOR_FREEDRIVE


@part
def _write_distances(state: ControllerState) -> None:
    """Write the distance of each joint from the reference to the first row of ``state.base``, rad."""
    write_base(state, state.base)
    for j in range(state.measured.size):
        state.base[0, j] = state.signals[Signal.POSITION, j] - state.base[0, j]


@part
def _check_limits(config: ControllerConfig, state: ControllerState) -> None:
    """Find exceeded limits; those of `config.limits.stops` are faults.

    If the arm has strayed from its reference, its error is the distance from the reference, not from the way back.
    """
    y, violations, errors = state.signals, 0, state.signals[Signal.POSITION_ERROR]
    if state.conditions[Condition.STRAYED]:
        _write_distances(state)
        errors = state.base[0]
    felt = state.status[Status.MODE] != Mode.FREEDRIVE  # There, a push is no collision.
    for j in range(state.measured.size):
        exceeded = 0
        least, most = config.limits.min_position[j], config.limits.max_position[j]
        margin = min(_BEYOND_RANGE * (most - least), _BEYOND_AT_MOST)
        if least != most and not least - margin <= state.measured[j] <= most + margin:
            exceeded |= Violation.POSITION
        if 0.0 < config.limits.velocity[j] < abs(y[Signal.VELOCITY, j]):
            exceeded |= Violation.VELOCITY
        if 0.0 < config.limits.tracking_error[j] < abs(errors[j]):
            exceeded |= Violation.TRACKING
        if felt and 0.0 < config.limits.external_effort[j] < abs(state.external[External.CHANGE, j]):
            exceeded |= Violation.EXTERNAL_EFFORT
        violations |= exceeded
        exceeded &= config.limits.stops
        if exceeded & Violation.POSITION:
            stop(state, Fault.POSITION_LIMIT, j + 1)
        elif exceeded & Violation.VELOCITY:
            stop(state, Fault.VELOCITY_LIMIT, j + 1)
        elif exceeded & Violation.TRACKING:
            stop(state, Fault.TRACKING_LIMIT, j + 1)
        elif exceeded & Violation.EXTERNAL_EFFORT:
            stop(state, Fault.EXTERNAL_EFFORT_LIMIT, j + 1)
    state.status[Status.VIOLATIONS] = violations


@part
def _limit_rate(config: ControllerConfig, state: ControllerState, stamp: int, since: float) -> None:
    """Limit the rate of the efforts, `since` (s) the last command; a stop that it delays is not limited any more."""
    times, conditions = state.times, state.conditions
    if state.status[Status.FAULT] == 0:
        _keep_up(config, state, stamp, limit_rate(config, state, since))
        return
    if rate_delay(config, state, since) <= _BEHIND_IN_STOP:
        times[Time.BEHIND_SINCE] = 0
    elif times[Time.BEHIND_SINCE] == 0:
        times[Time.BEHIND_SINCE] = stamp + 1
    # Holding keeps within the limit where it can; a damping torque may be demanded at once.
    longest = 0 if config.stop.holds else _LONGEST_BEHIND_IN_STOP
    if times[Time.BEHIND_SINCE] != 0 and stamp + 1 - times[Time.BEHIND_SINCE] >= longest:
        conditions[Condition.UNLIMITED] = 1
    if conditions[Condition.UNLIMITED] == 0:
        limit_rate(config, state, since)


@part
def _keep_up(config: ControllerConfig, state: ControllerState, stamp: int, behind: float) -> None:
    """Take a slower approach if the rate limit delays the effort by `behind` (s), and stop if that does not help.

    A limit that is too tight for the law would also prevent the stop, so the fault suspends it.
    """
    times, conditions, status = state.times, state.conditions, state.status
    if behind <= _BEHIND or status[Status.MODE] == Mode.FREEDRIVE:
        times[Time.BEHIND_SINCE] = 0
        return
    if times[Time.BEHIND_SINCE] == 0:
        times[Time.BEHIND_SINCE] = stamp + 1
    possible = stamp + 1 - times[Time.BEHIND_SINCE] <= _LONGEST_BEHIND
    if possible and config.uses_model:
        possible = begin_approach_here(config, state, stamp)
    if not possible:
        stop(state, Fault.EFFORT_RATE_LIMIT, 0)
        conditions[Condition.UNLIMITED] = 1
        make_safe(config, state, stamp, 0.0)


@njit
def respond(address: int, stamp: int, reference_stamp: int) -> tuple[int, int, int, int, int]:
    """`step` for Python; the results are ``effort`` and ``signals`` of the memory.

    Args:
        address: of the `ControllerMemory`.
        stamp: see `step`.
        reference_stamp: likewise.

    Returns:
        The status, in the order of `Status`.
    """
    memory = memory_at(address)
    step(memory.config, memory.state, stamp, reference_stamp)
    return _copy_result(memory)


@njit
def stop_now(address: int, fault: int, elapsed: int) -> None:
    """Replace the effort of the last step with the safe one while no joint state arrives; may be called repeatedly.

    Args:
        address: of the `ControllerMemory`.
        fault: fault that is latched, unless there is one already.
        elapsed: time since the last step, ns.
    """
    memory = memory_at(address)
    config, state = memory.config, memory.state
    times = state.times
    stop(state, fault, 0)
    if times[Time.SILENT_SINCE] == 0:
        times[Time.GAP] = elapsed
    now = times[Time.LAST] + elapsed
    make_safe_blindly(config, state, now)
    if config.rate_limited:
        _limit_rate(config, state, now, seconds(max(now - times[Time.SENT], 0)))
    times[Time.SENT] = now
    write_command(config, state, 0.0)
    _copy_result(memory)


@njit
def leave_now(address: int) -> None:
    """Replace the effort of the last step with the one that remains after the controller ends; see `stop_now`."""
    memory = memory_at(address)
    leave(memory.config, memory.state)
    write_command(memory.config, memory.state, 0.0)
    _copy_result(memory)


@njit
def tick_now(address: int, dt: float) -> None:
    """`tick` for Python; see `respond`."""
    memory = memory_at(address)
    tick(memory.config, memory.state, dt)


@inlined
def copy_signals(config: ControllerConfig, state: ControllerState, signals: Array) -> None:
    """Copy the signals of the last step, with the effort as it was commanded, to an array of shape (Signal, joints)."""
    y = state.signals
    for i in range(y.shape[0]):
        for j in range(y.shape[1]):
            signals[i, j] = y[i, j]
    if config.drive.late:
        for j in range(y.shape[1]):
            signals[Signal.EFFORT, j] = state.commanded[j]


@inlined
def _copy_result(memory: ControllerMemory) -> tuple[int, int, int, int, int]:
    """Copy the result to the arrays of the caller; return the status."""
    state, effort, status = memory.state, memory.effort, memory.state.status
    copy_signals(memory.config, state, memory.signals)
    for j in range(effort.size):
        effort[j] = state.output[j]
    return (
        status[Status.MODE],
        status[Status.FAULT],
        status[Status.FAULT_JOINT],
        status[Status.VIOLATIONS],
        status[Status.STOP_STAGE],
    )
