"""Changes of the status as text."""

import pytest
from support.testarms import Arm

from pidtsm_core.control import Condition, ControllerState, Time
from pidtsm_core.control.report import cause, changes
from pidtsm_core.control.state import new_state
from pidtsm_core.signals import Fault, Mode, Request, Stop, Violation

JOINTS = ("shoulder", "elbow")
FOLLOWS, HOLDS, FREE = [Mode.FOLLOWING, 0, 0, 0, 0], [Mode.HOLDING, 0, 0, 0, 0], [Mode.FREEDRIVE, 0, 0, 0, 0]
RANGE = "its position limits (limits.*_position)"
STOPPED = "; safe torque until ~/reset_fault is called"


def state(request: Request = Request.FOLLOW, **times: int) -> ControllerState:
    made = new_state(1, feeds_back=False)
    made.conditions[Condition.REQUEST] = request
    for name, value in times.items():
        made.times[Time[name]] = value
    return made


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        (Fault.STATE_STALE, "no joint state"),
        (Fault.POSITION_LIMIT, "{} is beyond its position limits (limits.*_position)"),
        (Fault.VELOCITY_LIMIT, "{} is beyond limits.velocity"),
        (Fault.TRACKING_LIMIT, "{} is beyond limits.tracking_error"),
        (Fault.EXTERNAL_EFFORT_LIMIT, "{} is beyond limits.external_effort"),
        (Fault.EFFORT_RATE_LIMIT, "limits.effort_rate is too tight for the motion of the arm"),
        (Fault.MEASUREMENT, "{} has implausible measurements (plausibility.velocity)"),
        (
            Fault.NO_EFFECT,
            "the torque has no effect on {}: it is locked or not powered, another controller drives it, or its "
            "measurements are stuck",
        ),
    ],
)
def test_every_fault_has_a_cause(arm: Arm, fault: Fault, text: str) -> None:
    joint, text = arm.joints, text.format(arm.names[-1])
    assert cause(fault, joint, arm.names) == text
    found = changes(FOLLOWS, [Mode.STOPPED, fault, joint, 0, 0], state(GAP=30_000_000), arm.names)
    age = " for 0.03 s" if fault == Fault.STATE_STALE else ""
    assert [(change.level, change.text) for change in found] == [("error", f"stopped: {text}{age}{STOPPED}")]


def test_the_causes_are_those_of_all_faults() -> None:
    for fault in Fault:
        if fault:
            assert cause(fault, 1, JOINTS)


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        (None, FOLLOWS, []),
        (None, HOLDS, []),
        (FOLLOWS, FOLLOWS, []),
        (HOLDS, FOLLOWS, [("info", "following the reference")]),
        (FOLLOWS, HOLDS, [("warning", "holding position: the reference is 0.25 s old")]),
        ([Mode.STOPPED, Fault.STATE_STALE, 0, 0, Stop.HOLD], HOLDS, [("info", "fault reset")]),
        (FOLLOWS, FREE, [("info", "freedrive: the arm can be moved by hand")]),
        (FREE, FREE, []),
        (FREE, FOLLOWS, [("info", "following the reference")]),
        (FOLLOWS, [0, 0, 0, Violation.VELOCITY, 0], [("warning", "a joint is beyond limits.velocity")]),
        ([0, 0, 0, Violation.VELOCITY, 0], [0, 0, 0, Violation.VELOCITY, 0], []),
        (
            FOLLOWS,
            [0, 0, 0, Violation.POSITION + Violation.TRACKING, 0],
            [
                ("warning", f"a joint is beyond {RANGE}"),
                ("warning", "a joint is beyond limits.tracking_error"),
            ],
        ),
        (
            FOLLOWS,
            [Mode.STOPPED, Fault.POSITION_LIMIT, 1, Violation.POSITION + Violation.VELOCITY, Stop.HOLD],
            [
                ("warning", "a joint is beyond limits.velocity"),
                ("error", f"stopped: shoulder is beyond its position limits (limits.*_position){STOPPED}"),
            ],
        ),
    ],
)
def test_a_change_is_reported_once(before: list[int] | None, after: list[int], expected: list[tuple[str, str]]) -> None:
    found = changes(before, after, state(REFERENCE_AGE=250_000_000), JOINTS)
    assert [(change.level, change.text) for change in found] == expected


@pytest.mark.parametrize("before", [FOLLOWS, FREE])
def test_holding_on_request_is_reported_as_such(before: list[int]) -> None:
    (change,) = changes(before, HOLDS, state(request=Request.HOLD), JOINTS)
    assert (change.level, change.text) == ("info", "holding position until ~/hold is called with false")


def test_a_reference_ahead_is_reported_as_such() -> None:
    (change,) = changes(FOLLOWS, HOLDS, state(REFERENCE_AGE=-3_600_000_000_000), JOINTS)
    assert change.text == "holding position: the reference is 3.6e+03 s ahead"
