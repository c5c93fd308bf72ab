"""The controller's one step: everything between a measured position and the commanded effort."""

from pidtsm_core.compiled import njit, outlined
from pidtsm_core.control.desired import begin_at, begin_way_here, choose, write_base
from pidtsm_core.control.effort import carry, limit_rate, make_safe
from pidtsm_core.control.state import Clock, ControllerConfig, ControllerState, parts
from pidtsm_core.control.tick import tick
from pidtsm_core.laws import Numbers
from pidtsm_core.parameters import Array
from pidtsm_core.signals import Fault, Limited, Mode, Signal, Status, Violation
from pidtsm_core.timing import NANOSECONDS, seconds

_BEHIND = 0.02
"""s that a rate limit may keep the effort behind the law before the arm takes another way."""
_LONGEST_BEHIND = NANOSECONDS // 2
"""ns of that without an end, after which the limit is too tight for the arm: a fault, which lifts the limit."""


@njit
def step(config: ControllerConfig, state: ControllerState, stamp: int, reference_stamp: int, truth: Array) -> None:
    """Answer the joint state in ``state.measured``; the result is in ``state.signals`` and ``state.status``.

    Args:
        config: what the step reads.
        state: what it changes.
        stamp: of the joint state, ns, later than the last.
        reference_stamp: of the reference in ``state.reference``, ns; negative where there is none.
        truth: true q', q'' for an estimator that `needs_truth`, shape (2, joints), else ignored.
    """
    clock, y = state.clock, state.signals
    if config.rehearses:
        _rehearse(config, state, stamp, reference_stamp)
    first = clock[Clock.ANSWERED] == 0
    period = 0 if first else stamp - clock[Clock.LAST]
    clock[Clock.GAP] = period
    if period > config.state_hold:
        clock[Clock.LATE] += 1
    if period > config.state_stop:
        stop(state, Fault.STATE_STALE, 0)
    if first:
        begin_at(state, state.measured)
        if config.rate_limited and clock[Clock.COMMANDED] == 0:
            carry(config, state, state.measured)
    choose(config, state, stamp, reference_stamp)

    dt = seconds(period)
    last = state.scratch[0]
    if config.rate_limited:
        for j in range(last.size):
            last[j] = y[Signal.EFFORT, j]
    tick(config, state, state.measured, truth, state.desired, dt)
    # A limit that is taken away is exceeded no more.
    state.status[Status.VIOLATIONS] = 0
    if config.watches:
        _check_limits(config, state)
    if state.status[Status.FAULT]:
        make_safe(config, state)
    if config.rate_limited and state.status[Status.FAULT] != Fault.EFFORT_RATE_LIMIT:
        _keep_up(config, state, stamp, limit_rate(config, state, last, dt))
    _count(state)
    clock[Clock.LAST] = stamp
    clock[Clock.ANSWERED] += 1
    clock[Clock.COMMANDED] = 1


@njit
def _count(state: ControllerState) -> None:
    """Count what limited the efforts."""
    limited = 0
    for j in range(state.measured.size):
        limited |= int(state.signals[Signal.SATURATED, j])
    if limited:
        state.clock[Clock.AT_EFFORT_LIMIT] += limited & Limited.EFFORT != 0
        state.clock[Clock.AT_RATE_LIMIT] += limited & Limited.RATE != 0


@outlined
def stop(state: ControllerState, fault: int, joint: int) -> None:
    """Latch a fault, unless there is one already; `joint` is the joint that caused it, from 1, 0: none."""
    status = state.status
    if status[Status.FAULT] == 0:
        status[Status.FAULT] = fault
        status[Status.FAULT_JOINT] = joint
        if status[Status.MODE] == Mode.FOLLOWING:
            begin_at(state, state.desired[0])
        status[Status.MODE] = Mode.STOPPED


@outlined
def begin_afresh(state: ControllerState) -> None:
    """Forget the motion so far; what follows begins where the arm is. A fault stays, and so does the effort."""
    y, clock = state.signals, state.clock
    for i in range(y.shape[0]):
        for j in range(y.shape[1]):
            if i != Signal.EFFORT:
                y[i, j] = 0.0
    for table in (state.estimator, state.law):
        for j in range(table.shape[0]):
            for slot in range(table.shape[1]):
                table[j, slot] = 0.0
    state.status[Status.VIOLATIONS] = 0
    clock[Clock.ANSWERED] = 0
    clock[Clock.BEHIND_SINCE] = 0


@outlined
def reset_fault(state: ControllerState) -> None:
    """Follow again after a fault."""
    state.status[Status.FAULT] = 0
    state.status[Status.FAULT_JOINT] = 0
    begin_afresh(state)


@outlined
def _distance(state: ControllerState) -> float:
    """How far the arm is from its reference, rad: the joint that is farthest."""
    distance = 0.0
    for j in range(state.measured.size):
        distance = max(distance, abs(state.reference[0, j] - state.measured[j]))
    return distance


@outlined
def _rehearse(config: ControllerConfig, state: ControllerState, stamp: int, reference_stamp: int) -> None:
    """Note when the controller began, and do what the parameters ``rehearsal`` want of this sample."""
    clock = state.clock
    if clock[Clock.BEGAN] == 0 or stamp < clock[Clock.BEGAN] - 1:
        clock[Clock.BEGAN] = stamp + 1
    age = stamp + 1 - clock[Clock.BEGAN]
    resets = 0 < config.reset_at <= age and clock[Clock.REHEARSED_RESET] == 0 and state.status[Status.FAULT] != 0
    if resets and (reference_stamp < 0 or _distance(state) <= config.distance):
        clock[Clock.REHEARSED_RESET] = 1
        reset_fault(state)
    if 0 < config.restart_at <= age and clock[Clock.REHEARSED_RESTART] == 0:
        clock[Clock.REHEARSED_RESTART] = 1
        clock[Clock.COMMANDED] = 0
        reset_fault(state)


@outlined
def _check_limits(config: ControllerConfig, state: ControllerState) -> None:
    """Find exceeded limits; those of `config.stops` are faults.

    Of an arm that has strayed from its reference the error is that to the reference, not to the way back.
    """
    y, violations, errors = state.signals, 0, state.signals[Signal.POSITION_ERROR]
    if state.clock[Clock.STRAYED]:
        errors = state.base[0]
        write_base(state, state.base)
        for j in range(errors.size):
            errors[j] = y[Signal.POSITION, j] - errors[j]
    for j in range(state.measured.size):
        exceeded = 0
        if 0.0 < config.position_limit[j] < abs(state.measured[j]):
            exceeded |= Violation.POSITION
        if 0.0 < config.velocity_limit[j] < abs(y[Signal.VELOCITY, j]):
            exceeded |= Violation.VELOCITY
        if 0.0 < config.tracking_limit[j] < abs(errors[j]):
            exceeded |= Violation.TRACKING
        violations |= exceeded
        exceeded &= config.stops
        if exceeded & Violation.POSITION:
            stop(state, Fault.POSITION_LIMIT, j + 1)
        elif exceeded & Violation.VELOCITY:
            stop(state, Fault.VELOCITY_LIMIT, j + 1)
        elif exceeded & Violation.TRACKING:
            stop(state, Fault.TRACKING_LIMIT, j + 1)
    state.status[Status.VIOLATIONS] = violations


@outlined
def _keep_up(config: ControllerConfig, state: ControllerState, stamp: int, behind: float) -> None:
    """Take a slower way where the rate limit keeps the effort `behind` (s), and stop where that does not help.

    A limit that is too tight for the law is too tight for the safe effort as well, whatever fault asked for that: it
    would keep the arm from being stopped. So this fault takes the place of any other, and lifts the limit.
    """
    clock, status = state.clock, state.status
    if behind <= _BEHIND:
        clock[Clock.BEHIND_SINCE] = 0
        return
    if clock[Clock.BEHIND_SINCE] == 0:
        clock[Clock.BEHIND_SINCE] = stamp + 1
    possible = stamp + 1 - clock[Clock.BEHIND_SINCE] <= _LONGEST_BEHIND
    if possible and config.uses_model and status[Status.FAULT] == 0:
        possible = begin_way_here(config, state, stamp)
    if not possible:
        status[Status.FAULT] = 0
        stop(state, Fault.EFFORT_RATE_LIMIT, 0)
        make_safe(config, state)


@njit
def respond(
    memory: Array, numbers: Numbers, stamp: int, reference_stamp: int, effort: Array, signals: Array
) -> tuple[int, int, int, int]:
    """`step` for Python, with few arguments: see `parts`.

    Args:
        memory: of the controller.
        numbers: likewise.
        stamp: see `step`.
        reference_stamp: likewise.
        effort: result, shape (joints,), N m.
        signals: result, shape (len(Signal), joints).

    Returns:
        The status, in the order of `Status`.
    """
    config, state = parts(memory, numbers)
    # No estimator of a node reads the truth.
    step(config, state, stamp, reference_stamp, state.desired)
    return _told(state, effort, signals)


@njit
def stop_now(memory: Array, numbers: Numbers, fault: int, elapsed: int, effort: Array, signals: Array) -> None:
    """Replace the effort of the last step by the safe one.

    Args:
        memory: of the controller, see `parts`.
        numbers: likewise.
        fault: to be latched; 0: none.
        elapsed: since the last step, ns, for the limit of the rate; negative: the limit does not apply.
        effort: result, shape (joints,), N m.
        signals: result, shape (len(Signal), joints).
    """
    config, state = parts(memory, numbers)
    if fault:
        stop(state, fault, 0)
        state.clock[Clock.GAP] = elapsed
    last = state.scratch[0]
    for j in range(last.size):
        last[j] = state.signals[Signal.EFFORT, j]
    make_safe(config, state)
    if elapsed >= 0:
        limit_rate(config, state, last, seconds(elapsed))
    _told(state, effort, signals)


@njit
def _told(state: ControllerState, effort: Array, signals: Array) -> tuple[int, int, int, int]:
    """Copy the result to where it is sent from."""
    y, status = state.signals, state.status
    for i in range(y.shape[0]):
        for j in range(y.shape[1]):
            signals[i, j] = y[i, j]
    for j in range(effort.size):
        effort[j] = y[Signal.EFFORT, j]
    return status[Status.MODE], status[Status.FAULT], status[Status.FAULT_JOINT], status[Status.VIOLATIONS]
