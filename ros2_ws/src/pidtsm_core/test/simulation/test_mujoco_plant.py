"""MuJoCo as engine: the motion of the other engine, and what only MuJoCo has."""

import gc
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson
from support.testarms import PANDA, PENDULUM, TWO_LINK, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.rollouts.closed_loop import DivergedError, rollout
from pidtsm_core.simulation.plant import Plant, plant_schema
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema

DT = 0.001
RIGID = {"robot.coriolis": "lagrange", "disturbance.name": "none"}
"""Of the two-link arm: what follows Lagrange's equations; MuJoCo holds a disturbance over a step."""
CHANGES: dict[str, dict[str, Any]] = {
    "nothing": {},
    "payload": {"payload.mass": 0.5, "payload.time": 0.01, "payload.duration": 0.02},
    "push": {"push.effort": 2.0, "push.time": 0.01, "push.duration": 0.02},
    "push of the tool": {
        "push.force": [3.0, -2.0, 4.0],
        "push.torque": [0.1, 0.3, -0.2],
        "push.time": 0.01,
        "push.duration": 0.02,
        "model_error.length": 0.1,
    },
    "masses": {"model_error.mass": 0.3, "model_error.inertia": -0.2},
    "lengths": {"model_error.length": 0.1},
    "viscous": {"friction.viscous": 0.3},
    "coarse": {"rate": 500},
}
SHAPE = {"payload.center_of_mass": [0.02, -0.01, 0.05], "payload.inertia": [0.02, 0.03, 0.015, 0.002, 0.001, -0.003]}


def values_of(arm: Arm, engine: str, changes: dict[str, Any], schema: Any = plant_schema) -> Any:
    rigid = RIGID if arm is TWO_LINK else {}
    return arm.values(schema, {"engine": engine, "initial_position": arm.start, **rigid, **changes})


def plants_of(arm: Arm, changes: dict[str, Any]) -> list[Plant]:
    """The same arm on both engines."""
    return [Plant(values_of(arm, engine, changes)) for engine in ("rigid_body", "mujoco")]


def step(plant: Plant, effort: Array, steps: int, dt: float = DT) -> Array:
    """States after each step, shape (steps, 3, joints)."""
    states = []
    for k in range(steps):
        plant.step(effort, k * dt, dt)
        states.append(np.vstack([plant.state.position, plant.state.derivatives]))
    return np.array(states)


@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES)
def test_both_engines_move_the_arm_alike(arm: Arm, changes: dict[str, Any]) -> None:
    changes = {**changes, **(SHAPE if "payload.mass" in changes and arm is not TWO_LINK else {})}
    effort, dt = arm.effort(arm.start, ddq=arm.alternating(1.0)), 1.0 / changes.get("rate", 1000)
    ours, theirs = (step(plant, effort, 40, dt) for plant in plants_of(arm, changes))
    assert np.abs(ours[:, 1]).max() > 0.03
    np.testing.assert_allclose(theirs, ours, atol=1e-9, rtol=1e-7)


def test_locked_joints_are_rigid() -> None:
    settings = {**PANDA.settings, "joints": ["panda_joint2", "panda_joint4"], "robot.locked": "panda_joint3=0.7"}
    part = Arm(PANDA.description, (0.4, -1.6))
    part.settings.update(settings)
    effort = part.effort(part.start, ddq=1.0)
    ours, theirs = (step(plant, effort, 40) for plant in plants_of(part, {}))
    np.testing.assert_allclose(theirs, ours, atol=1e-9, rtol=1e-7)


def test_dry_friction_is_the_same_curve() -> None:
    """MuJoCo holds it over a step, hence the tolerance."""
    changes = {"friction.coulomb": 2.0, "friction.static": 3.0}
    ours, theirs = (step(plant, np.array([20.0]), 300) for plant in plants_of(PENDULUM, changes))
    without = step(plants_of(PENDULUM, {})[0], np.array([20.0]), 300)
    apart = np.abs(without[-1, 0] - ours[-1, 0])
    assert apart > 1e-3
    assert np.abs(theirs[:, 0] - ours[:, 0]).max() < 0.01 * apart


@pytest.mark.parametrize("integrator", ["euler", "implicit", "implicitfast"])
def test_integrator_and_step_are_chosen(integrator: str) -> None:
    effort = PANDA.effort(PANDA.start, ddq=1.0)
    ours = step(plants_of(PANDA, {})[0], effort, 100)
    errors = []
    for timestep in (0.001, 0.0005, 0.0003):  # The last one divides a period into four steps.
        plant = Plant(values_of(PANDA, "mujoco", {"mujoco.integrator": integrator, "mujoco.timestep": timestep}))
        errors.append(np.abs(step(plant, effort, 100)[-1, 0] - ours[-1, 0]).max())
    assert 0.0 < errors[0] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)
    assert errors[0] / errors[2] == pytest.approx(4.0, rel=0.1)


def test_a_joint_limit_stops_the_arm() -> None:
    ours, theirs = (step(plant, np.array([60.0]), 2000) for plant in plants_of(PENDULUM, {}))
    assert ours[:, 0].max() > 3.0
    assert theirs[:, 0].max() < 2.2
    assert theirs[-1, 0, 0] == pytest.approx(2.0, abs=0.02)


def test_brakes_stop_the_arm_as_on_the_other_engine(arm: Arm) -> None:
    positions = []
    for engine in ("rigid_body", "mujoco"):
        robot = SimulatedRobot(values_of(arm, engine, {"command.timeout": 0.005}, simulator_schema))
        effort = arm.effort(arm.start, ddq=1.0)
        for k in range(60):
            robot.sense(k)
            robot.act(k, 2 < k < 20, effort)
        assert robot.braked
        positions.append(robot.state.arm.position.copy())
        robot.reset(values_of(arm, engine, {}, simulator_schema))
        assert robot.state.arm.position.tolist() == list(arm.start)
    assert np.abs(positions[0] - arm.start).max() > 1e-5
    np.testing.assert_allclose(positions[1], positions[0], atol=1e-9)


def test_picking_up_and_dropping_compile_nothing() -> None:
    """It would take longer than the controller waits for a joint state."""
    values = values_of(PANDA, "mujoco", {"payload.mass": 1.0, "payload.time": 1e9})
    plant = Plant(values)
    assert plant.mujoco is not None
    models = plant.mujoco.models
    for changes in ({"payload.time": 0.0}, {"payload.duration": 0.5}):
        plant.set_parameters({**values, **changes})
        assert plant.mujoco.models is models
    plant.set_parameters({**values, "payload.mass": 2.0})
    assert plant.mujoco.models is not models


def test_new_parameters_keep_the_state() -> None:
    effort = PANDA.effort(PANDA.start, ddq=1.0)
    ours, theirs = plants_of(PANDA, {})
    for plant, engine in ((ours, "rigid_body"), (theirs, "mujoco")):
        step(plant, effort, 20)
        plant.set_parameters(values_of(PANDA, engine, {"payload.mass": 1.0, "friction.viscous": 2.0}))
    moved = [step(plant, effort, 20) for plant in (ours, theirs)]
    np.testing.assert_allclose(moved[1], moved[0], atol=1e-9, rtol=1e-7)


@pytest.mark.parametrize("viscous", [0.0, 0.5])
@pytest.mark.parametrize("engine", ["rigid_body", "mujoco"])
def test_the_work_of_the_efforts_is_in_the_energy_or_dissipated(arm: Arm, engine: str, viscous: float) -> None:
    """Of ~/ground_truth: an effort is held over a period, so its work is effort times way."""
    plant = Plant(values_of(arm, engine, {"friction.viscous": viscous}))
    energy, parameters = arm.robot.dynamics.energy, plant.config.model.parameters
    work, amplitude = 0.0, arm.inertia
    before = energy(plant.state.position, plant.state.derivatives[0], parameters)
    velocities = [plant.state.derivatives[0].copy()]
    for k in range(400):
        start = plant.state.position.copy()
        wanted = arm.effort(arm.start) + amplitude * math.cos(10.0 * k * DT)
        plant.step(wanted, k * DT, DT)
        work += float(plant.state.effort @ (plant.state.position - start))
        velocities.append(plant.state.derivatives[0].copy())
    gained = energy(plant.state.position, plant.state.derivatives[0], parameters) - before
    dissipated = float(simpson(viscous * np.square(velocities), dx=DT, axis=0).sum())
    assert abs(gained) > 1e-3
    assert dissipated > 1e-4 or viscous == 0.0
    assert gained + dissipated == pytest.approx(work, rel=1e-6)


def test_a_rollout_is_repeatable_bit_for_bit_and_outlives_its_plant() -> None:
    def run() -> bytes:
        gc.collect()
        made = rollout(robot="panda", duration=0.5, simulator={"engine": "mujoco", "payload.mass": 1.0})
        return made.position.tobytes() + made.effort.tobytes()

    assert run() == run()


def test_a_simulation_that_diverges_ends_without_leaving_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    wild = {"engine": "mujoco", "robot.m1": 1e-9, "robot.m2": 1e-9, "robot.j1": 1e-9, "robot.j2": 1e-9}
    with pytest.raises(DivergedError, match="not finite"):
        rollout(duration=0.5, simulator=wild)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"engine": "bullet"}, "engine: 'bullet' must be one of rigid_body, mujoco"),
        ({"engine": "mujoco", "robot.coriolis": "paper"}, "robot.coriolis: 'paper' must be one of lagrange"),
        ({"mujoco.timestep": 1e-3}, "timestep belongs to engine mujoco"),
        (
            {"engine": "mujoco", "robot.m1": 0.0},
            r"robot\.description: link link1: a joint moves it, and it",
        ),
    ],
)
def test_what_mujoco_cannot_simulate_is_refused(changes: dict[str, Any], reason: str) -> None:
    with pytest.raises(ParameterError, match=reason):
        Plant(TWO_LINK.values(plant_schema, changes))


def test_a_link_whose_joints_are_both_locked_and_free_is_refused() -> None:
    inertial = '<inertial pos="0 0 0.1" mass="1" diaginertia="0.1 0.1 0.1"/>'
    joints = '<joint name="pan" axis="0 0 1"/><joint name="tilt" axis="0 1 0"/>'
    head = Arm(f'<mujoco><worldbody><body name="head">{joints}{inertial}</body></worldbody></mujoco>', (0.1,))
    head.settings.update({"joints": ["pan"], "limits.effort": 5.0})
    with pytest.raises(ParameterError, match="link head: one of its joints is locked and another is not"):
        Plant(values_of(head, "mujoco", {}))
