"""Properties of every robot model."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import resolve
from pidtsm_core.robots import (
    NAMES,
    Robot,
    effort_spread,
    find_robot,
    forward_dynamics,
    inverse_dynamics,
    make_model,
    robot_schema,
)
from pidtsm_core.robots.effort_differences import spread_of_differences
from pidtsm_core.robots.payload import Payload
from pidtsm_core.robots.two_link import TWO_LINK
from pidtsm_core.simulation.plant import Plant, plant_schema

PROPERTY = settings(deadline=None, max_examples=50)
ALL = [find_robot({"robot.description": name}) for name in NAMES]
EACH = pytest.mark.parametrize("robot", ALL, ids=lambda r: r.name)
SEEDS = st.integers(min_value=0, max_value=2**32 - 1)


def options(robot: Robot, coriolis: str | None = None) -> dict[str, object]:
    """Settings that choose the robot, and its form of the Coriolis matrix if it has more than one."""
    chosen: dict[str, object] = {"robot.description": robot.name}
    if coriolis and any(p.name == "coriolis" for p in robot.parameters):
        chosen["robot.coriolis"] = coriolis
    return chosen


def model(robot: Robot, coriolis: str | None = None) -> Array:
    return robot.pack_model(resolve(robot_schema, options(robot, coriolis), len(robot.joints)))


def forms(robot: Robot) -> list[str | None]:
    return next((list(p.choices) for p in robot.parameters if p.name == "coriolis"), [None])


def torque(robot: Robot, q: Array, dq: Array, ddq: Array, p: Array) -> Array:
    effort = np.full((1, q.size), np.nan)
    inverse_dynamics(make_model(robot, p), q, dq, ddq[np.newaxis], effort)
    return effort[0]


def acceleration(robot: Robot, q: Array, dq: Array, effort: Array, p: Array) -> Array:
    ddq = np.full(q.size, np.nan)
    forward_dynamics(make_model(robot, p), q, dq, effort, ddq)
    return ddq


def inertia(robot: Robot, q: Array, dq: Array, p: Array) -> Array:
    """H(q), column by column from the inverse dynamics."""
    bias = torque(robot, q, dq, np.zeros(q.size), p)
    return np.column_stack([torque(robot, q, dq, unit, p) - bias for unit in np.eye(q.size)])


def random_state(robot: Robot, seed: int) -> tuple[Array, Array, Array]:
    random = np.random.default_rng(seed)
    n = len(robot.joints)
    return random.uniform(-4, 4, n), random.uniform(-5, 5, n), random.uniform(-50, 50, n)


@EACH
@PROPERTY
@given(seed=SEEDS)
def test_forward_dynamics_is_the_inverse_of_inverse_dynamics(robot: Robot, seed: int) -> None:
    q, dq, ddq = random_state(robot, seed)
    for form in forms(robot):
        p = model(robot, form)
        effort = torque(robot, q, dq, ddq, p)
        back = acceleration(robot, q, dq, effort, p)
        np.testing.assert_allclose(back, ddq, rtol=0, atol=1e-12 * max(np.abs(ddq).max(), np.abs(effort).max()))


@EACH
@PROPERTY
@given(seed=SEEDS)
def test_torque_is_affine_in_acceleration_with_a_symmetric_positive_definite_inertia(robot: Robot, seed: int) -> None:
    q, dq, ddq = random_state(robot, seed)
    for form in forms(robot):
        p = model(robot, form)
        h = inertia(robot, q, dq, p)
        np.testing.assert_allclose(h, h.T, atol=1e-11 * np.abs(h).max())
        assert np.linalg.eigvalsh(0.5 * (h + h.T)).min() > 0.0
        np.testing.assert_allclose(h, inertia(robot, q, np.zeros(q.size), p), atol=1e-10 * np.abs(h).max())
        expected = h @ ddq + torque(robot, q, dq, np.zeros(q.size), p)
        np.testing.assert_allclose(torque(robot, q, dq, ddq, p), expected, atol=1e-10 * np.abs(expected).max())


def gradient(function: object, at: Array, step: float = 1e-5) -> Array:
    """Central differences of a function of a vector."""
    shifts = step * np.eye(at.size)
    return np.array([(function(at + d) - function(at - d)) / (2 * step) for d in shifts])  # type: ignore[operator]


@EACH
@PROPERTY
@given(seed=SEEDS)
def test_gravity_is_the_gradient_of_the_energy_at_rest(robot: Robot, seed: int) -> None:
    q, _, _ = random_state(robot, seed)
    rest = np.zeros(q.size)
    p = model(robot)
    gravity = torque(robot, q, rest, rest, p)
    np.testing.assert_allclose(gradient(lambda x: robot.dynamics.energy(x, rest, p), q), gravity, atol=1e-6)


@EACH
@PROPERTY
@given(seed=SEEDS)
def test_kinetic_energy_is_that_of_the_inertia(robot: Robot, seed: int) -> None:
    q, dq, _ = random_state(robot, seed)
    p = model(robot)
    kinetic = robot.dynamics.energy(q, dq, p) - robot.dynamics.energy(q, np.zeros(q.size), p)
    assert kinetic == pytest.approx(0.5 * dq @ inertia(robot, q, dq, p) @ dq, rel=1e-9)


@EACH
@PROPERTY
@given(seed=SEEDS)
def test_energy_changes_by_the_power_of_the_torque(robot: Robot, seed: int) -> None:
    q, dq, effort = random_state(robot, seed)
    p = model(robot, "lagrange")
    ddq = acceleration(robot, q, dq, effort, p)
    rate = (
        gradient(lambda x: robot.dynamics.energy(x, dq, p), q) @ dq
        + gradient(lambda v: robot.dynamics.energy(q, v, p), dq) @ ddq
    )
    assert rate == pytest.approx(dq @ effort, rel=1e-6, abs=1e-4)


def free_motion(robot: Robot, coriolis: str | None) -> tuple[float, float]:
    """Largest change of the energy over 10 s without torque or disturbance, and the energy's scale, J."""
    chosen = {**options(robot, coriolis), "disturbance.name": "none", "friction.viscous": 0.0, "friction.coulomb": 0.0}
    plant = Plant(resolve(plant_schema, chosen, len(robot.joints)))
    p = plant.config.model.parameters
    effort = np.zeros(plant.joints)
    q, dq = plant.state.position, plant.state.derivatives[0]
    dq[:] = 1.0  # Some robots do not fall from rest.
    start = robot.dynamics.energy(q, dq, p)
    worst = scale = 0.0
    # The arms without heavy rotors fall faster.
    steps = 10_000 if np.isinf(robot.joint_inertia(p, q)).all() else 20_000
    for k in range(steps):
        plant.step(effort, k * 10.0 / steps, 10.0 / steps)
        if k % 20 == 19:
            now = robot.dynamics.energy(q, dq, p)
            worst = max(worst, abs(now - start))
            scale = max(scale, now - robot.dynamics.energy(q, 0.0 * dq, p))
    return worst, scale


@EACH
def test_energy_is_conserved_without_torque(robot: Robot) -> None:
    worst, scale = free_motion(robot, "lagrange")
    assert scale > 0.1, "the arm should move"
    assert worst < 1e-8 * scale


@pytest.mark.parametrize("robot", [r for r in ALL if "paper" in forms(r)], ids=lambda r: r.name)
def test_the_printed_coriolis_matrix_does_not_conserve_energy(robot: Robot) -> None:
    worst, scale = free_motion(robot, "paper")
    assert worst > 1e-3 * scale


@EACH
@PROPERTY
@given(seed=SEEDS, mass=st.floats(0.01, 10.0), more=st.floats(0.01, 10.0))
def test_a_payload_adds_inertia_and_weight(robot: Robot, seed: int, mass: float, more: float) -> None:
    q, dq, _ = random_state(robot, seed)
    p = model(robot)
    kept = p.copy()
    np.testing.assert_array_equal(robot.with_payload(p, Payload(0.0)), p)
    loaded = robot.with_payload(p, Payload(mass))
    np.testing.assert_array_equal(p, kept)
    twice, both = robot.with_payload(loaded, Payload(more)), robot.with_payload(p, Payload(mass + more))
    np.testing.assert_allclose(twice, both, rtol=1e-12, atol=1e-15)
    added = inertia(robot, q, dq, loaded) - inertia(robot, q, dq, p)
    assert np.linalg.eigvalsh(0.5 * (added + added.T)).min() > -1e-9
    assert np.trace(added) > 0.0


@EACH
def test_the_defaults_fit_the_joints(robot: Robot) -> None:
    assert len(robot.effort_limit) == len(robot.initial_position) == len(set(robot.joints))
    assert min(robot.effort_limit) > 0.0


@pytest.mark.parametrize("bounded", [True, False], ids=["bound", "differences"])
@EACH
@PROPERTY
@given(seed=SEEDS)
def test_efforts_in_a_box_differ_by_no_more_than_their_spread(robot: Robot, bounded: bool, seed: int) -> None:
    """The estimate for a closed form that gives no bound only holds for small boxes."""
    random, (q, dq, ddq) = np.random.default_rng(seed), random_state(robot, seed)
    for form in forms(robot):
        p = model(robot, form)
        made, n = make_model(robot, p), q.size
        scale = random.choice([1e-6, 1e-3, *([1e-2, 0.3] if bounded else [])])
        box, spread = scale * random.uniform(0.0, 1.0, (3, n)) * np.array([[1.0], [2.0], [20.0]]), np.zeros((3, n))
        middle = torque(robot, q, dq, ddq, p)
        if bounded:
            effort_spread(made, q, dq, ddq, box, spread)
        else:
            spread_of_differences(robot.dynamics.inverse_dynamics)(q, dq, ddq, box, p, spread)
        sides = random.choice([-1.0, 1.0, 0.3], (30, 3, n))
        changes = [np.abs(torque(robot, q + d[0], dq + d[1], ddq + d[2], p) - middle) for d in sides * box]
        assert (np.max(changes, axis=0) <= spread[0] + 1e-9 * (1.0 + np.abs(middle))).all()


def test_a_closed_form_from_outside_moves_as_the_same_one_of_this_package() -> None:
    """Compiled code contains the one, and calls the other by its address."""
    known, dynamics = TWO_LINK.dynamics, replace(TWO_LINK.dynamics, energy=lambda q, dq, p: 0.0)
    outside = replace(TWO_LINK, dynamics=dynamics)
    p = TWO_LINK.pack_model({f"robot.{each.name}": each.default for each in TWO_LINK.parameters})
    q, dq, ddq = np.random.default_rng(3).normal(size=(3, 2))
    box = np.full((3, 2), 0.1)
    results = []
    for robot in (TWO_LINK, outside):
        model = make_model(robot, p)
        effort, back, spread = np.zeros((1, 2)), np.zeros(2), np.zeros((3, 2))
        inverse_dynamics(model, q, dq, ddq.reshape(1, 2), effort)
        forward_dynamics(model, q, dq, effort[0], back)
        effort_spread(model, q, dq, ddq, box, spread)
        results.append(np.vstack([effort, back, spread[0]]))
    assert make_model(outside, p).kind != make_model(TWO_LINK, p).kind
    assert known is not dynamics
    np.testing.assert_array_equal(results[0], results[1])
