"""What the controller does: follow, hold, be free or stop; and how it begins afresh or goes on."""

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.breakaway import forget_rests
from pidtsm_core.control.compliance import forget_compliance
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.desired import begin_at
from pidtsm_core.control.handover import expect_handover
from pidtsm_core.control.history import shift_history
from pidtsm_core.control.state import Condition, ControllerState, Count, Handover, Held, Time, part
from pidtsm_core.control.stopping import forget_law, keep_what_holds
from pidtsm_core.control.trust import is_doubtful, trust
from pidtsm_core.signals import Mode, Request, Signal, Status, Stop


@part
def stop(state: ControllerState, fault: int, joint: int) -> None:
    """Latch a fault, unless there is one already; `joint` is the joint that caused it, counted from 1; 0: none."""
    status = state.status
    if status[Status.FAULT] == 0:
        status[Status.FAULT] = fault
        status[Status.FAULT_JOINT] = joint
        if status[Status.MODE] == Mode.FOLLOWING:
            begin_at(state, state.desired[0])
        status[Status.MODE] = Mode.STOPPED
        state.times[Time.BEHIND_SINCE] = 0
        state.conditions[Condition.HANDOVER] = Handover.NONE
        if state.conditions[Condition.REQUEST] == Request.FREE:
            request(state, Request.HOLD)


@part
def request(state: ControllerState, wanted: int) -> None:
    """Follow, hold or be free from the next step on, see `Request`."""
    conditions = state.conditions
    if wanted == Request.FOLLOW and conditions[Condition.REQUEST] != Request.FOLLOW:
        conditions[Condition.GENTLE] = 1
    conditions[Condition.REQUEST] = wanted


@inlined
def hold_elsewhere(state: ControllerState) -> None:
    """Because a stopped arm that is held may have moved, hold it at its new position."""
    if state.conditions[Condition.HELD] != Held.NOT:
        state.conditions[Condition.HELD] = Held.ELSEWHERE


@inlined
def hold_unseen(state: ControllerState) -> None:
    """Because a stopped arm that is held was not seen for a while, hold it at its place only if it is near."""
    if state.conditions[Condition.HELD] == Held.HERE:
        state.conditions[Condition.HELD] = Held.UNSEEN


@part
def begin_afresh(state: ControllerState) -> None:
    """Forget the motion so far and start from where the arm is. A fault stays, and so does the effort."""
    y, counts, conditions, times = state.signals, state.counts, state.conditions, state.times
    for i in range(y.shape[0]):
        for j in range(y.shape[1]):
            if i != Signal.EFFORT:
                y[i, j] = 0.0
    for table in (state.estimator, state.law, state.friction_inputs):
        for j in range(table.shape[0]):
            for slot in range(table.shape[1]):
                table[j, slot] = 0.0
    forget_law(state)
    forget_rests(state)
    state.status[Status.VIOLATIONS] = 0
    hold_elsewhere(state)
    counts[Count.ANSWERED] = 0
    conditions[Condition.HANDOVER] = Handover.NONE
    times[Time.FREED] = 0
    for j in range(state.implausible.size):
        state.implausible[j] = state.rejected[j] = 0.0
        for i in range(state.external.shape[0]):
            state.external[i, j] = 0.0
    times[Time.BEHIND_SINCE] = counts[Count.NOTES] = 0
    for i in range(state.still.shape[0]):
        for j in range(state.implausible.size):
            state.still[i, j] = 0.0
    forget_compliance(state)


@part
def reset_fault(config: ControllerConfig, state: ControllerState) -> None:
    """Reset the fault, so that the controller can follow again.

    An arm that was held stays where it is, under the effort that holds it, until the law has taken over.
    """
    conditions, counts, status = state.conditions, state.counts, state.status
    resumes = (
        conditions[Condition.COMMANDED] != 0
        and conditions[Condition.HELD] == Held.HERE
        and status[Status.STOP_STAGE] == Stop.HOLD
    )
    for j in range(state.measured.size):
        resumes = resumes and not is_doubtful(state, j)
        trust(state, j)
    if resumes:
        keep_what_holds(config, state)
        expect_handover(state)
        conditions[Condition.GENTLE] = 1
    else:
        begin_afresh(state)
    status[Status.FAULT] = status[Status.FAULT_JOINT] = status[Status.STOP_STAGE] = 0
    conditions[Condition.HELD] = Held.NOT
    conditions[Condition.BRAKES] = conditions[Condition.UNLIMITED] = counts[Count.RESTED] = 0
    state.hold_pace[0] = 0.0


@part
def set_clock(state: ControllerState, stamp: int) -> None:
    """Continue as if the last joint state had arrived at `stamp` (ns), because the clock of the stamps was set."""
    times = state.times
    later = stamp - times[Time.LAST]
    times[Time.LAST] += later
    times[Time.SENT] += later
    if times[Time.FREED]:
        times[Time.FREED] += later
    if times[Time.DEGRADED_SINCE]:
        times[Time.DEGRADED_SINCE] += later
    shift_history(state, later)
    times[Time.APPROACH_BEGAN] += later
    if times[Time.BEGAN]:
        times[Time.BEGAN] += later
    if times[Time.BEHIND_SINCE]:
        times[Time.BEHIND_SINCE] += later
