"""Changes of a controller's status as text: for logs, tables and reports."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pidtsm_core.control.configuration import loaded_model
from pidtsm_core.control.state import Condition, ControllerState, Time
from pidtsm_core.parameters import Value, joint_array, names
from pidtsm_core.robots import find_robot, inverse_dynamics
from pidtsm_core.signals import Fault, Mode, Request, Status, Stop, Violation
from pidtsm_core.timing import seconds

_NAMED = {
    Violation.POSITION: "its position limits (limits.*_position)",
    Violation.VELOCITY: "limits.velocity",
    Violation.TRACKING: "limits.tracking_error",
    Violation.EXTERNAL_EFFORT: "limits.external_effort",
}
_OF_FAULTS = {
    Fault.POSITION_LIMIT: Violation.POSITION,
    Fault.VELOCITY_LIMIT: Violation.VELOCITY,
    Fault.TRACKING_LIMIT: Violation.TRACKING,
    Fault.EXTERNAL_EFFORT_LIMIT: Violation.EXTERNAL_EFFORT,
}
_FALL = 1.0  # rad
_CONFIGURATIONS = 500


@dataclass(frozen=True)
class Change:
    """A change of the status.

    Attributes:
        level: level in a log: info, warning or error.
        text: one sentence.
    """

    level: str
    text: str


def cause(fault: int, joint: int, joints: Sequence[str]) -> str:
    """Why the controller has stopped.

    Args:
        fault: see `Fault`.
        joint: the joint that caused it, counted from 1; 0: no single joint.
        joints: names of the joints.
    """
    if fault == Fault.STATE_STALE:
        return "no joint state"
    if fault == Fault.MEASUREMENT:
        return f"{joints[joint - 1]} has implausible measurements (plausibility.velocity)"
    if fault == Fault.NO_EFFECT:
        return (
            f"the torque has no effect on {joints[joint - 1]}: it is locked or not powered, another controller drives "
            "it, or its measurements are stuck"
        )
    if fault == Fault.EFFORT_RATE_LIMIT:
        return "limits.effort_rate is too tight for the motion of the arm"
    return f"{joints[joint - 1]} is beyond {_NAMED[_OF_FAULTS[Fault(fault)]]}"


def changes(
    before: Sequence[int] | None, after: Sequence[int], state: ControllerState, joints: Sequence[str]
) -> list[Change]:
    """The changes between two statuses.

    Args:
        before: shape (len(Status),), order of `Status`; None at the start.
        after: likewise.
        state: of the controller.
        joints: names of the joints.
    """
    start = [Mode.HOLDING, *[0] * (len(Status) - 1)]
    return list(_changes(start if before is None else before, after, state, joints, before is None))


def _changes(
    before: Sequence[int], after: Sequence[int], state: ControllerState, joints: Sequence[str], first: bool
) -> Iterator[Change]:
    fault = after[Status.FAULT]
    for violation, name in _NAMED.items():
        stops = _OF_FAULTS.get(Fault(fault)) == violation
        if violation & after[Status.VIOLATIONS] & ~before[Status.VIOLATIONS] and not stops:
            yield Change("warning", f"a joint is beyond {name}")
    if fault != before[Status.FAULT]:
        if not fault:
            yield Change("info", "fault reset")
        else:
            reason = cause(fault, after[Status.FAULT_JOINT], joints)
            if fault == Fault.STATE_STALE:
                reason += f" for {seconds(int(state.times[Time.GAP])):.3g} s"
            yield Change("error", f"stopped: {reason}; safe torque until ~/reset_fault is called")
    yield from _stages(before[Status.STOP_STAGE], after[Status.STOP_STAGE])
    modes = before[Status.MODE], after[Status.MODE]
    if modes[0] == modes[1]:
        return
    if modes[1] == Mode.FREEDRIVE:
        yield Change("info", "freedrive: the arm can be moved by hand")
    elif modes[1] == Mode.HOLDING and state.conditions[Condition.REQUEST] == Request.HOLD:
        yield Change("info", "holding position until ~/hold is called with false")
    elif modes[1] == Mode.FOLLOWING and modes[0] != Mode.STOPPED and not first:
        yield Change("info", "following the reference")
    elif modes == (Mode.FOLLOWING, Mode.HOLDING):
        age = seconds(int(state.times[Time.REFERENCE_AGE]))
        late = f"the reference is {abs(age):.3g} s {'old' if age > 0 else 'ahead'}" if age else "there is no reference"
        yield Change("warning", f"holding position: {late}")


def _stages(before: int, after: int) -> Iterator[Change]:
    """Changes of the way in which a stopped arm is kept safe."""
    if after == before:
        return
    if after == Stop.DAMPING:
        yield Change("warning", "the stopped arm has left its place: it is damped instead of held")
    elif after == Stop.GRAVITY:
        yield Change("error", "a joint gets faster although it is damped: the arm is only carried, with weak damping")
    elif after == Stop.HOLD and before in (Stop.DAMPING, Stop.GRAVITY):
        yield Change("info", "the stopped arm is held where it is now")


def tight_rates(values: Mapping[str, Value]) -> list[str]:
    """Warnings about rate limits that are too low: gravity moves the joint far before the effort can hold it.

    Far means a radian, or a metre. Computed from rest, in the worst of many random configurations with a constant seed.

    Args:
        values: every parameter of the controller.
    """
    joints = names(values["joints"])
    rates = joint_array(values["limits.effort_rate"], len(joints))
    if not rates.any():
        return []
    robot = find_robot(values)
    model = loaded_model(values, robot)
    random, still, found = np.random.default_rng(0), np.zeros(len(joints)), []
    accelerations, efforts = np.zeros((2, len(joints))), np.zeros((2, len(joints)))
    needed = np.zeros((3, len(joints)))  # rate, effort, time
    for _ in range(_CONFIGURATIONS):
        q = random.uniform(-math.pi, math.pi, len(joints))
        for j in range(len(joints)):
            accelerations[1] = 0.0
            accelerations[1, j] = 1.0
            inverse_dynamics(model, q, still, accelerations, efforts)
            gravity, inertia = abs(efforts[0, j]), efforts[1, j] - efforts[0, j]
            if gravity > needed[1, j]:
                fall = math.sqrt(2.0 * _FALL * inertia / gravity)
                needed[:, j] = gravity / fall, gravity, fall
    for joint, unit, rate, (least, effort, fall) in zip(joints, robot.units, rates, needed.T, strict=True):
        if 0.0 < rate < least:
            found.append(
                f"limits.effort_rate of {joint} is {rate:g} {unit.effort}/s: the effort that carries it, up to "
                f"{effort:.3g} {unit.effort}, takes {effort / rate:.2g} s, and gravity moves it by {_FALL:g} "
                f"{unit.position} in {fall:.2g} s; at least {least:.2g} {unit.effort}/s would hold it"
            )
    return found
