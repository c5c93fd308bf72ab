"""The simulated arm: limits, payload, integration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.disturbances import add_disturbance
from pidtsm_core.parameters import Array, ParameterError, resolve
from pidtsm_core.robots import Robot, find_robot, forward_dynamics, robot_joints
from pidtsm_core.simulation.plant import Plant, plant_schema

EACH = pytest.mark.parametrize(
    "robot", [find_robot({"robot.description": name}) for name in ("two_link", "scara", "panda")], ids=lambda r: r.name
)
DT = 0.001


def plant_of(**changes: object) -> Plant:
    """A plant; parameter names with two underscores instead of the dot."""
    chosen = {name.replace("__", "."): value for name, value in changes.items()}
    return Plant(resolve(plant_schema, chosen, robot_joints(chosen)))


def state(plant: Plant) -> Array:
    return np.vstack([plant.state.position, plant.state.derivatives])


def acceleration(plant: Plant, q: Array, dq: Array, effort: Array) -> Array:
    """q'' under torque and disturbance, without the payload."""
    net, ddq = effort.copy(), np.zeros(q.size)
    add_disturbance(plant.config.disturbance, q, dq, net)
    forward_dynamics(plant.config.model, q, dq, net, ddq)
    return ddq


@settings(deadline=None, max_examples=50)
@given(effort=st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 2))
def test_torque_is_limited(effort: tuple[float, float]) -> None:
    plant = plant_of(limits__effort=(100.0, 50.0))
    limited = np.clip(effort, [-100.0, -50.0], [100.0, 50.0])
    plant.step(np.array(effort), 0.0, DT)
    np.testing.assert_array_equal(plant.state.effort, limited)
    other = plant_of(limits__effort=(100.0, 50.0))
    other.step(limited, 0.0, DT)
    assert state(plant).tobytes() == state(other).tobytes()


@EACH
def test_the_start_is_at_rest_at_the_default_or_given_position(robot: Robot) -> None:
    plant = plant_of(robot__description=robot.name, disturbance__name="none")
    np.testing.assert_array_equal(plant.state.position, robot.initial_position)
    assert not plant.state.derivatives.any()
    assert not plant.state.effort.any()
    elsewhere = np.linspace(0.3, 0.9, plant.joints)
    moved = plant_of(robot__description=robot.name, disturbance__name="none", initial_position=tuple(elsewhere))
    np.testing.assert_array_equal(moved.state.position, elsewhere)
    moved.step(np.zeros(plant.joints), 0.0, DT)
    assert np.abs(moved.state.position - elsewhere).max() < 1e-3
    np.testing.assert_array_equal(elsewhere, np.linspace(0.3, 0.9, plant.joints))


def test_the_payload_is_there_from_its_time_on_and_not_before() -> None:
    effort = np.array([30.0, 10.0])
    empty, loaded = plant_of(), plant_of(payload__mass=0.5, payload__time=0.01)
    for k in range(30):
        assert (state(empty).tobytes() == state(loaded).tobytes()) == (k <= 10), k
        for plant in (empty, loaded):
            plant.step(effort, k / 1000, DT)


@pytest.mark.parametrize(("time", "duration"), [(0.01, 0.02), (0.1, 0.2), (0.0, 0.005)])
def test_a_payload_is_dropped_after_its_duration(time: float, duration: float) -> None:
    effort = np.array([30.0, 10.0])
    carrying = plant_of(payload__mass=0.5, payload__time=time, payload__duration=duration)
    by_hand, values = plant_of(), [resolve(plant_schema, {"payload.mass": mass}, 2) for mass in (0.0, 0.5)]
    for k in range(400):
        by_hand.set_parameters(values[round(1000 * time) <= k < round(1000 * (time + duration))])
        for plant in (carrying, by_hand):
            plant.step(effort, k / 1000, DT)
        assert state(carrying).tobytes() == state(by_hand).tobytes(), k


def test_a_payload_is_a_heavier_last_link() -> None:
    effort = np.array([30.0, 10.0])
    loaded, heavy = plant_of(payload__mass=0.5), plant_of(robot__m2=2.0)
    for k in range(100):
        for plant in (loaded, heavy):
            plant.step(effort, k / 1000, DT)
    assert state(loaded).tobytes() == state(heavy).tobytes()


def test_a_push_acts_for_its_duration_and_does_not_count_as_torque() -> None:
    effort = np.array([30.0, 10.0])
    pushed = plant_of(push__effort=(0.0, 4.0), push__time=0.1, push__duration=0.2)
    alone, helped = plant_of(), plant_of()
    for k in range(400):
        assert (state(pushed).tobytes() == state(alone).tobytes()) == (k <= 100), k
        assert state(pushed).tobytes() == state(helped).tobytes(), k
        pushed.step(effort, k / 1000, DT)
        alone.step(effort, k / 1000, DT)
        helped.step(effort + np.array([0.0, 4.0 if 100 <= k < 300 else 0.0]), k / 1000, DT)
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
    wrong, right = plant_of(**error), plant_of(**changed)
    np.testing.assert_allclose(wrong.config.model.parameters, right.config.model.parameters, rtol=1e-15)


def test_friction_brings_a_moving_arm_to_rest_and_keeps_it_without_chatter() -> None:
    """Without gravity and disturbance."""
    plant = plant_of(
        robot__g=0.0,
        disturbance__name="none",
        friction__coulomb=20.0,
        friction__static=30.0,
        robot__coriolis="lagrange",
    )
    for k in range(500):
        plant.step(np.array([90.0, 45.0]) if k < 100 else np.zeros(2), k * DT, DT)
        if k == 100:
            assert np.abs(plant.state.derivatives[0]).max() > 0.1
    speeds = []
    for k in range(500, 1000):
        plant.step(np.zeros(2), k * DT, DT)
        speeds.append(np.abs(plant.state.derivatives[0]).max())
    assert speeds[0] < 1e-6
    assert (np.diff(speeds) <= 0.0).all()


def test_acceleration_is_that_under_the_torque_held() -> None:
    plant = plant_of()
    effort = np.array([25.0, -3.0])
    for k in range(20):
        plant.step(effort, k / 1000, DT)
        q, (dq, ddq) = plant.state.position, plant.state.derivatives
        np.testing.assert_array_equal(ddq, acceleration(plant, q, dq, effort))


def after(steps: int, time: float, **changes: object) -> Array:
    plant = plant_of(initial_position=(0.5, -0.8), **changes)
    for k in range(steps):
        plant.step(np.array([40.0, -8.0]), k * time / steps, time / steps)
    return state(plant)[:2]


@pytest.mark.parametrize("disturbance", ["none", "article"])
@pytest.mark.parametrize("coriolis", ["paper", "lagrange"])
def test_integration_is_of_fourth_order(disturbance: str, coriolis: str) -> None:
    chosen = {"disturbance__name": disturbance, "robot__coriolis": coriolis}
    exact = after(3200, 1.0, **chosen)
    errors = [np.abs(after(steps, 1.0, **chosen) - exact).max() for steps in (25, 50, 100)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.3)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.2)


def test_torque_is_held_over_the_whole_step() -> None:
    """Compare with a fine integration, with one torque over a long step and another over the next one."""
    plant = plant_of()
    y = state(plant)[:2]

    def rate(y: Array, effort: Array) -> Array:
        return np.array([y[1], acceleration(plant, y[0], y[1], effort)])

    for k, effort in enumerate([np.array([40.0, 5.0]), np.array([-20.0, 15.0])]):
        plant.step(effort, k * 0.01, 0.01)
        for _ in range(1000):
            middle = y + 0.5e-5 * rate(y, effort)
            y = y + 1e-5 * rate(middle, effort)
        np.testing.assert_allclose(state(plant)[:2], y, atol=1e-9)


def test_the_torque_given_is_not_kept_by_reference() -> None:
    plant = plant_of()
    effort = np.array([500.0, 5.0])
    plant.step(effort, 0.0, DT)
    assert effort.tolist() == [500.0, 5.0]
    effort[:] = 0.0
    assert plant.state.effort.tolist() == [100.0, 5.0]


def test_new_parameters_keep_the_state() -> None:
    plant = plant_of()
    plant.step(np.array([30.0, 10.0]), 0.0, DT)
    before = state(plant)
    plant.set_parameters(resolve(plant_schema, {"payload.mass": 1.0, "limits.effort": 5.0}, 2))
    np.testing.assert_array_equal(state(plant), before)
    plant.step(np.array([30.0, 10.0]), DT, DT)
    assert plant.state.effort.tolist() == [5.0, 5.0]


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
def test_invalid_values_are_refused(name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=name):
        resolve(plant_schema, {name: value}, 2)
