"""The simulated arm: limits, payload, integration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.testarms import ARMS, TWO_LINK, Arm, dotted

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.robots import forward_dynamics
from pidtsm_core.robots.tree.layout import GRAVITY
from pidtsm_core.simulation.disturbances import add_disturbance
from pidtsm_core.simulation.plant import Plant, plant_schema

DT = 0.001
FORMS = ("paper", "lagrange")


def plant_of(arm: Arm, **changes: object) -> Plant:
    """A plant; parameter names with two underscores instead of the dot."""
    return Plant(arm.values(plant_schema, dotted(changes)))


def some_effort(arm: Arm) -> Array:
    """A torque that moves every joint."""
    return arm.effort(arm.robot.initial_position, ddq=arm.alternating(2.0))


def state(plant: Plant) -> Array:
    return np.vstack([plant.state.position, plant.state.derivatives])


def acceleration(plant: Plant, q: Array, dq: Array, effort: Array) -> Array:
    """q'' under torque and disturbance, without the payload."""
    net, ddq = effort.copy(), np.zeros(q.size)
    add_disturbance(plant.config.disturbance, 0.0, q, dq, net)
    forward_dynamics(plant.config.model, q, dq, net, ddq)
    return ddq


@settings(deadline=None, max_examples=12)
@given(efforts=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=7, max_size=7))
def test_torque_is_limited(arm: Arm, efforts: list[float]) -> None:
    effort, plant, other = np.array(efforts[: arm.joints]), plant_of(arm), plant_of(arm)
    limited = np.clip(effort, -arm.limits, arm.limits)
    plant.step(effort, 0.0, DT)
    np.testing.assert_array_equal(plant.state.effort, limited)
    other.step(limited, 0.0, DT)
    assert state(plant).tobytes() == state(other).tobytes()


def test_the_start_is_at_rest_at_the_default_or_given_position(arm: Arm) -> None:
    plant = plant_of(arm, disturbance__name="none")
    np.testing.assert_array_equal(plant.state.position, arm.robot.initial_position)
    assert not plant.state.derivatives.any()
    assert not plant.state.effort.any()
    elsewhere = arm.spread(0.3, 0.9)
    moved = plant_of(arm, disturbance__name="none", initial_position=elsewhere)
    np.testing.assert_array_equal(moved.state.position, elsewhere)
    moved.step(np.zeros(arm.joints), 0.0, DT)
    assert np.abs(moved.state.position - elsewhere).max() < 1e-3


def test_the_payload_is_there_from_its_time_on_and_not_before(arm: Arm) -> None:
    effort = some_effort(arm)
    empty, loaded = plant_of(arm), plant_of(arm, payload__mass=0.5, payload__time=0.01)
    for k in range(30):
        assert (state(empty).tobytes() == state(loaded).tobytes()) == (k <= 10), k
        for plant in (empty, loaded):
            plant.step(effort, k / 1000, DT)


@pytest.mark.parametrize(("time", "duration"), [(0.01, 0.02), (0.1, 0.2), (0.0, 0.005)])
def test_a_payload_is_dropped_after_its_duration(arm: Arm, time: float, duration: float) -> None:
    effort = some_effort(arm)
    carrying = plant_of(arm, payload__mass=0.5, payload__time=time, payload__duration=duration)
    by_hand, values = plant_of(arm), [arm.values(plant_schema, {"payload.mass": mass}) for mass in (0.0, 0.5)]
    changes = {round(1000 * time): 1, round(1000 * (time + duration)): 0}
    for k in range(400):
        if k in changes:
            by_hand.set_parameters(values[changes[k]])
        for plant in (carrying, by_hand):
            plant.step(effort, k / 1000, DT)
        assert state(carrying).tobytes() == state(by_hand).tobytes(), k


def test_a_payload_is_a_heavier_last_link() -> None:
    """Of the two-link arm; those of descriptions: see the tests of the robots."""
    effort = np.array([30.0, 10.0])
    loaded, heavy = plant_of(TWO_LINK, payload__mass=0.5), plant_of(TWO_LINK, robot__m2=2.0)
    for k in range(100):
        for plant in (loaded, heavy):
            plant.step(effort, k / 1000, DT)
    assert state(loaded).tobytes() == state(heavy).tobytes()


def test_a_push_acts_for_its_duration_and_does_not_count_as_torque(arm: Arm) -> None:
    effort, push = some_effort(arm), np.zeros(arm.joints)
    push[-1] = 0.08 * arm.limits[-1]
    pushed = plant_of(arm, push__effort=push.tolist(), push__time=0.1, push__duration=0.2)
    alone, helped = plant_of(arm), plant_of(arm)
    for k in range(400):
        assert (state(pushed).tobytes() == state(alone).tobytes()) == (k <= 100), k
        assert state(pushed).tobytes() == state(helped).tobytes(), k
        pushed.step(effort, k / 1000, DT)
        alone.step(effort, k / 1000, DT)
        helped.step(effort + (push if 100 <= k < 300 else 0.0), k / 1000, DT)
        np.testing.assert_array_equal(pushed.state.effort, effort)


@pytest.mark.parametrize(
    ("error", "changed"),
    [
        ({"model_error__mass": 0.25}, {"robot__m1": 0.625, "robot__m2": 1.875}),
        ({"model_error__inertia": -0.25}, {"robot__j1": 3.75, "robot__j2": 3.75}),
        ({"model_error__length": 0.1}, {"robot__r1": 1.1, "robot__r2": 0.935}),
    ],
    ids="".join,
)
def test_a_model_error_scales_all_parameters_of_its_kind(error: dict[str, float], changed: dict[str, float]) -> None:
    wrong, right = plant_of(TWO_LINK, **error), plant_of(TWO_LINK, **changed)
    np.testing.assert_allclose(wrong.config.model.parameters, right.config.model.parameters, rtol=1e-15)


def weightless(arm: Arm, **changes: object) -> Plant:
    """A plant without gravity and disturbance."""
    if arm is TWO_LINK:
        return plant_of(arm, robot__g=0.0, robot__coriolis="lagrange", disturbance__name="none", **changes)
    plant = plant_of(arm, **changes)
    for model in (plant.config.model, plant.config.loaded_model):
        model.parameters[:GRAVITY] = 0.0
    return plant


def test_friction_brings_a_moving_arm_to_rest_and_keeps_it_without_chatter(arm: Arm) -> None:
    coulomb, static = (0.2 * arm.limits).tolist(), (0.3 * arm.limits).tolist()
    plant = weightless(arm, friction__coulomb=coulomb, friction__static=static)
    for k in range(500):
        plant.step(0.9 * arm.limits if k < 50 else np.zeros(arm.joints), k * DT, DT)
        if k == 50:
            assert np.abs(plant.state.derivatives[0]).max() > 0.1
    speeds = []
    for k in range(500, 1000):
        plant.step(np.zeros(arm.joints), k * DT, DT)
        speeds.append(np.abs(plant.state.derivatives[0]).max())
    assert speeds[0] < 1e-6
    assert (np.diff(speeds) <= 0.0).all()


def test_acceleration_is_that_under_the_torque_held(arm: Arm) -> None:
    plant, effort = plant_of(arm, friction__viscous=0.0), some_effort(arm)
    for k in range(20):
        plant.step(effort, k / 1000, DT)
        q, (dq, ddq) = plant.state.position, plant.state.derivatives
        np.testing.assert_array_equal(ddq, acceleration(plant, q, dq, effort))


def after(arm: Arm, steps: int, time: float, **changes: object) -> Array:
    plant = plant_of(arm, initial_position=arm.start, **changes)
    for k in range(steps):
        plant.step(arm.effort(arm.start, ddq=1.0), k * time / steps, time / steps)
    return state(plant)[:2]


@pytest.mark.parametrize(
    ("arm", "changes"),
    [
        *((TWO_LINK, {"disturbance__name": d, "robot__coriolis": c}) for d in ("none", "article") for c in FORMS),
        *((arm, {}) for arm in ARMS if arm is not TWO_LINK),
    ],
    indirect=["arm"],
    ids=str,
)
def test_integration_is_of_fourth_order(arm: Arm, changes: dict[str, object]) -> None:
    exact = after(arm, 1600, 1.0, **changes)
    errors = [np.abs(after(arm, steps, 1.0, **changes) - exact).max() for steps in (25, 50, 100)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.3)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.2)


def test_torque_is_held_over_the_whole_step(arm: Arm) -> None:
    """Compare with a fine integration, with one torque over a long step and another over the next one."""
    plant, period = plant_of(arm, friction__viscous=0.0), 0.005
    y = state(plant)[:2]

    def rate(y: Array, effort: Array) -> Array:
        return np.array([y[1], acceleration(plant, y[0], y[1], effort)])

    for k, share in enumerate([1.0, -1.0]):
        effort = some_effort(arm) + share * arm.inertia
        plant.step(effort, k * period, period)
        h = period / 500
        for _ in range(500):
            middle = y + 0.5 * h * rate(y, effort)
            y = y + h * rate(middle, effort)
        np.testing.assert_allclose(state(plant)[:2], y, atol=1e-9)


def test_the_torque_given_is_not_kept_by_reference(arm: Arm) -> None:
    plant = plant_of(arm)
    effort = 0.5 * arm.limits
    effort[0] = 5.0 * arm.limits[0]
    kept, limited = effort.copy(), np.minimum(effort, arm.limits)
    plant.step(effort, 0.0, DT)
    np.testing.assert_array_equal(effort, kept)
    effort[:] = 0.0
    np.testing.assert_array_equal(plant.state.effort, limited)


def test_new_parameters_keep_the_state(arm: Arm) -> None:
    plant = plant_of(arm)
    plant.step(0.5 * arm.limits, 0.0, DT)
    before = state(plant)
    plant.set_parameters(arm.values(plant_schema, {"payload.mass": 1.0, "limits.effort": 2.0}))
    np.testing.assert_array_equal(state(plant), before)
    plant.step(0.5 * arm.limits, DT, DT)
    assert plant.state.effort.tolist() == [2.0] * arm.joints


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("payload.mass", -1.0),
        ("payload.time", -1.0),
        ("payload.duration", -1.0),
        ("rate", 0),
        ("disturbance.name", "wind"),
        ("limits.effort", 0.0),
    ],
)
def test_invalid_values_are_refused(arm: Arm, name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=name):
        arm.values(plant_schema, {name: value})
