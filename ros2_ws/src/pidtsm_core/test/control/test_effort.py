"""Limits of the effort and of its rate, and the safe effort."""

import numpy as np
import pytest
from support.testarms import Arm

from pidtsm_core.control import Condition, Controller, Count, controller_schema
from pidtsm_core.signals import Fault, Limited, Signal

MS = 1_000_000
START = 1_000_000_000
AT_ONCE = {"activation.blend": 0.0, "plausibility.velocity": 0.0}
"""No way to the reference, and an arm that may jump."""


def controller_of(arm: Arm, **changes: object) -> Controller:
    """A controller; parameter names with two underscores instead of the dot."""
    return arm.controller(**{**AT_ONCE, **changes})


@pytest.mark.parametrize("kind", ["gravity_damping", "gravity", "damping", "zero"])
@pytest.mark.parametrize("each", [False, True], ids=["one damping", "a damping for each joint"])
def test_the_safe_effort_is_the_chosen_one(arm: Arm, kind: str, each: bool) -> None:
    damping = (0.05 * arm.limits).tolist() if each else 0.3 * arm.limits.min()
    controller = controller_of(arm, stop__effort=kind, stop__damping=damping)
    velocity = np.resize([2.0, -1.0], arm.joints)
    for k in range(100):
        controller.position[:] = arm.start + 0.001 * k * velocity
        controller.step(START + k * MS + (k > 50) * 30 * MS, -1)
    assert controller.fault == Fault.STATE_STALE
    q, dq = controller.signals[[Signal.POSITION, Signal.VELOCITY]]
    assert np.abs(dq).min() > 0.5
    expected = arm.effort(q) * ("gravity" in kind) - np.array(damping) * dq * ("damping" in kind)
    assert (np.abs(expected) < arm.limits).all()
    np.testing.assert_allclose(controller.effort, expected, rtol=1e-12, atol=1e-12)


def test_the_rate_limit_does_not_delay_the_first_torque(arm: Arm) -> None:
    controller = controller_of(arm, limits__effort_rate=10.0)
    controller.position[:] = arm.start
    controller.step(START, -1)
    np.testing.assert_allclose(controller.effort, arm.effort(arm.start), rtol=1e-12, atol=1e-12)
    assert not controller.signals[Signal.SATURATED].any()


@pytest.mark.parametrize("gap", [1, 3, 15])
def test_the_torque_may_change_by_the_rate_times_the_time_that_has_passed(arm: Arm, gap: int) -> None:
    rates = arm.limits * arm.spread(2.0, 1.0)
    controller = controller_of(arm, limits__effort_rate=rates.tolist(), law__name="pid")
    controller.step(START, -1)
    before = controller.effort.copy()
    controller.position[:] = arm.alternating(0.5)
    controller.step(START + gap * MS, -1)
    expected = -np.sign(controller.position) * rates * gap * 1e-3
    np.testing.assert_allclose(controller.effort - before, expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("rate", "moved", "limited"),
    [
        (0.0, 0.0, 0),
        (0.5, 0.0, 0),
        (0.5, -2e-4, Limited.RATE),
        (10.0, -0.005, Limited.EFFORT + Limited.RATE),
        (0.0, -1.0, Limited.EFFORT),
        (1e4, -1.0, Limited.EFFORT),
    ],
)
def test_active_limits_are_reported_and_counted(arm: Arm, rate: float, moved: float, limited: int) -> None:
    """The rate is a share of the limit; stronger motors than those of the two-link arm need a larger motion."""
    rates, strength = np.zeros(arm.joints), 0.1 * arm.limits[0] / arm.inertia[0]
    rates[0] = rate * arm.limits[0]
    controller = controller_of(arm, limits__effort_rate=rates.tolist(), law__name="computed_torque")
    controller.step(START, -1)
    before = controller.effort[0]
    controller.position[0] = moved * strength
    controller.step(START + MS, -1)
    assert controller.signals[Signal.SATURATED, 0] == limited
    if limited & Limited.RATE:
        assert controller.effort[0] == before + rates[0] * 0.001
    elif limited:
        assert controller.effort[0] == arm.limits[0]
    assert controller.state.counts[Count.AT_EFFORT_LIMIT] == (limited & Limited.EFFORT != 0)
    assert controller.state.counts[Count.AT_RATE_LIMIT] == (limited & Limited.RATE != 0)


@pytest.mark.parametrize("stop", ["hold", "gravity_damping"])
def test_without_a_joint_state_the_safe_torque_changes_within_the_rate_limit(arm: Arm, stop: str) -> None:
    settings = {**AT_ONCE, "law.name": "pid", "stop.effort": stop}
    controller = Controller(arm.values(controller_schema, settings))
    # The hold keeps within the limit only if the arm does not go astray meanwhile.
    off = 0.02 if stop == "hold" else 0.1
    controller.position[:], controller.reference[0] = arm.start, np.array(arm.start) + off
    for k in range(200):
        controller.step(START + k * MS, START + k * MS)
    before = [controller.effort.copy()]
    assert (np.abs(before[0] - arm.effort(arm.start)) / arm.limits).max() > 0.6 * off
    rates = (20.0 if stop == "hold" else 1.0) * arm.limits
    controller.set_parameters(arm.values(controller_schema, {**settings, "limits.effort_rate": rates.tolist()}))
    for elapsed in (20, 25, 40):
        controller.stop(Fault.STATE_STALE, elapsed * MS)
        before.append(controller.effort.copy())
    # At the next joint state, the change is limited from the last command on.
    controller.step(START + 240 * MS, -1)
    before.append(controller.effort.copy())
    assert controller.fault == Fault.STATE_STALE
    # Held joints that are light would go astray within the limit.
    assert not controller.state.conditions[Condition.UNLIMITED] or (stop == "hold" and arm.joints > 2)
    allowed = np.outer([0.02, 0.005, 0.015, 0.001], rates)
    if controller.state.conditions[Condition.UNLIMITED]:
        allowed = np.tile(0.08 * arm.limits, (4, 1))
    assert (np.abs(np.diff(before, axis=0)) <= allowed + 1e-9).all()


def test_the_rate_limit_does_not_delay_the_last_torque(arm: Arm) -> None:
    controller = controller_of(arm, stop__effort="gravity", limits__effort_rate=1.0)
    controller.position[:] = arm.start
    for k in range(3):
        controller.step(START + k * MS, -1)
    controller.leave()
    np.testing.assert_allclose(controller.effort, arm.effort(arm.start), rtol=1e-9, atol=1e-9)
