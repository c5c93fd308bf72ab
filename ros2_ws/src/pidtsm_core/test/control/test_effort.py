"""Limits of the effort and of its rate, and the safe effort."""

import numpy as np
import pytest

from pidtsm_core.control import Clock, Controller, controller_schema
from pidtsm_core.parameters import Array, resolve
from pidtsm_core.robots.two_link import TWO_LINK
from pidtsm_core.signals import Fault, Limited, Signal

MS = 1_000_000
START = 1_000_000_000
LIMITS = np.array([100.0, 50.0])


def controller_of(**changes: object) -> Controller:
    """A controller without a way to its reference; parameter names with two underscores instead of the dot."""
    values = {
        "activation.blend": 0.0,
        "plausibility.velocity": 0.0,
        **{n.replace("__", "."): v for n, v in changes.items()},
    }
    return Controller(resolve(controller_schema, values, 2))


def gravity(q: Array) -> Array:
    """Torque that carries the arm at rest, N m, shape (2,)."""
    effort = np.zeros((1, 2))
    model = TWO_LINK.pack_model({f"robot.{p.name}": p.default for p in TWO_LINK.parameters})
    TWO_LINK.dynamics.inverse_dynamics(q, np.zeros(2), np.zeros((1, 2)), model, effort)
    return effort[0]


@pytest.mark.parametrize("kind", ["gravity_damping", "gravity", "damping", "zero"])
@pytest.mark.parametrize("damping", [20.0, [5.0, 1.0]])
def test_the_safe_effort_is_the_chosen_one(kind: str, damping: object) -> None:
    controller = controller_of(stop__effort=kind, stop__damping=damping)
    for k in range(100):
        controller.position[:] = 0.3 + 0.002 * k, -0.2 - 0.001 * k
        controller.step(START + k * MS + (k > 50) * 30 * MS, -1)
    assert controller.fault == Fault.STATE_STALE
    q, dq = controller.signals[[Signal.POSITION, Signal.VELOCITY]]
    assert np.abs(dq).min() > 0.5
    expected = gravity(q) * ("gravity" in kind) - np.array(damping) * dq * ("damping" in kind)
    np.testing.assert_allclose(controller.effort, expected, rtol=1e-12, atol=1e-12)


def test_the_rate_limit_does_not_delay_the_first_torque() -> None:
    controller = controller_of(limits__effort_rate=10.0)
    controller.position[:] = 0.3, -0.2
    controller.step(START, -1)
    np.testing.assert_allclose(controller.effort, gravity(controller.position), rtol=1e-12)
    assert not controller.signals[Signal.SATURATED].any()


@pytest.mark.parametrize("gap", [1, 3, 15])
def test_the_torque_may_change_by_the_rate_times_the_time_that_has_passed(gap: int) -> None:
    controller = controller_of(limits__effort_rate=[200.0, 50.0], law__name="pid")
    controller.position[:] = 0.0, 0.0
    controller.step(START, -1)
    before = controller.effort.copy()
    controller.position[:] = 0.5, -0.5
    controller.step(START + gap * MS, -1)
    np.testing.assert_allclose(controller.effort - before, np.array([-200.0, 50.0]) * gap * 1e-3, rtol=1e-9)


@pytest.mark.parametrize(
    ("rate", "moved", "limited"),
    [
        (0.0, 0.0, 0),
        (50.0, 0.0, 0),
        (50.0, -2e-4, Limited.RATE),
        (1e3, -0.005, Limited.EFFORT + Limited.RATE),
        (0.0, -1.0, Limited.EFFORT),
        (1e6, -1.0, Limited.EFFORT),
    ],
)
def test_active_limits_are_reported_and_counted(rate: float, moved: float, limited: int) -> None:
    controller = controller_of(limits__effort_rate=[rate, 0.0], law__name="computed_torque")
    controller.step(START, -1)
    before = controller.effort[0]
    controller.position[0] = moved
    controller.step(START + MS, -1)
    assert controller.signals[Signal.SATURATED, 0] == limited
    if limited & Limited.RATE:
        assert controller.effort[0] == before + rate * 0.001
    elif limited:
        assert controller.effort[0] == LIMITS[0]
    assert controller.clock(Clock.AT_EFFORT_LIMIT) == (limited & Limited.EFFORT != 0)
    assert controller.clock(Clock.AT_RATE_LIMIT) == (limited & Limited.RATE != 0)


@pytest.mark.parametrize("stop", ["hold", "gravity_damping"])
def test_without_a_joint_state_the_safe_torque_changes_within_the_rate_limit(stop: str) -> None:
    controller = controller_of(law__name="pid", stop__effort=stop)
    controller.position[:], controller.reference[0] = (0.3, -0.2), (0.4, -0.1)
    for k in range(200):
        controller.step(START + k * MS, START + k * MS)
    before = [controller.effort.copy()]
    assert np.abs(before[0] - gravity(controller.position)).min() > 3.0
    limited = {"law.name": "pid", "stop.effort": stop, "plausibility.velocity": 0.0, "limits.effort_rate": 100.0}
    controller.set_parameters(resolve(controller_schema, limited, 2))
    for elapsed in (20, 25, 40):
        controller.stop(Fault.STATE_STALE, elapsed * MS)
        before.append(controller.effort.copy())
    # At the next joint state, the change is limited from the last command on.
    controller.step(START + 240 * MS, -1)
    before.append(controller.effort.copy())
    assert controller.fault == Fault.STATE_STALE
    allowed = 100.0 * np.array([[0.02], [0.005], [0.015], [0.001]])
    assert (np.abs(np.diff(before, axis=0)) <= allowed + 1e-9).all()


def test_the_rate_limit_does_not_delay_the_last_torque() -> None:
    controller = controller_of(stop__effort="gravity", limits__effort_rate=1.0)
    controller.position[:] = 0.3, -0.2
    for k in range(3):
        controller.step(START + k * MS, -1)
    controller.leave()
    np.testing.assert_allclose(controller.effort, gravity(controller.position), rtol=1e-9)
