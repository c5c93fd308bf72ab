"""Elastic joints, judged by the two-mass solution, SciPy's integrator, and MuJoCo with a motor body of its own."""

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.testarms import PANDA, PENDULUM, TWO_LINK, Arm, dotted

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.robots.base import unit_accelerations
from pidtsm_core.robots.tree.layout import GRAVITY
from pidtsm_core.rollouts.closed_loop import DivergedError, rollout
from pidtsm_core.simulation.plant import Plant, plant_schema
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema

DT = 0.001
RIGID = {"disturbance.name": "none"}
LINK = 0.1 + 4.0 * 0.4**2
"""Inertia of the pendulum about its joint, kg m^2."""


def plant_of(arm: Arm, **changes: object) -> Plant:
    extra = {"robot.coriolis": "lagrange"} if arm is TWO_LINK else {}
    return Plant(arm.values(plant_schema, {"initial_position": list(arm.start), **RIGID, **extra, **dotted(changes)}))


def two_masses(stiffness: float, damping: float, rotor: float) -> Plant:
    """The pendulum without gravity: rotor and link, coupled by a twisted spring, at rest."""
    plant = plant_of(
        PENDULUM,
        elasticity__stiffness=stiffness,
        elasticity__damping=damping,
        robot__armature=rotor,
        initial_position=0.0,
    )
    for model in (plant.config.model, plant.config.loaded_model):
        model.parameters[:GRAVITY] = 0.0
    plant.rest(np.zeros(1))
    plant.state.drivetrain.motor[:] = 0.01
    return plant


def twist(plant: Plant) -> float:
    return float(plant.state.drivetrain.motor[0] - plant.state.position[0])


@pytest.mark.parametrize(
    ("stiffness", "damping", "rotor"), [(1e3, 0.5, 0.1), (2e4, 3.0, 0.2), (1e5, 5.0, 0.1), (1e5, 3.0, 0.02)]
)
def test_two_masses_vibrate_as_their_solution(stiffness: float, damping: float, rotor: float) -> None:
    """The samples of a damped vibration satisfy x_n = a x_n-1 + b x_n-2, whose roots are exp(poles dt)."""
    plant, samples = two_masses(stiffness, damping, rotor), []
    for k in range(120):
        samples.append(twist(plant))
        plant.step(np.zeros(1), k * DT, DT)
    x = np.array(samples)
    (a, b), *_ = np.linalg.lstsq(np.column_stack([x[1:-1], x[:-2]]), x[2:], rcond=None)
    pole = np.log(np.roots([1.0, -a, -b]).astype(complex)[0]) / DT
    inertia = 1.0 / (1.0 / rotor + 1.0 / LINK)
    natural, ratio = math.sqrt(stiffness / inertia), damping / (2.0 * math.sqrt(stiffness * inertia))
    assert abs(pole) == pytest.approx(natural, rel=1e-3)
    assert -pole.real / abs(pole) == pytest.approx(ratio, rel=1e-3)


def test_the_energy_of_two_masses_stays() -> None:
    plant = two_masses(2e4, 0.0, 0.2)
    drives, energies = plant.state.drivetrain, []
    for k in range(10_000):
        speed, motor = plant.state.derivatives[0, 0], drives.motor_velocity[0]
        energies.append(0.5 * (LINK * speed**2 + 0.2 * motor**2 + 2e4 * twist(plant) ** 2))
        plant.step(np.zeros(1), k * DT, DT)
    assert np.ptp(energies) < 1e-6 * energies[0]


def test_any_stiffness_is_stable() -> None:
    """Up to 1e5 N m/rad with a rotor of 1e-4 kg m^2, which vibrates with 5 kHz, and far beyond."""
    for stiffness in (1e5, 1e7, 1e12):
        plant = two_masses(stiffness, 0.0, 1e-4)
        for k in range(500):
            plant.step(np.full(1, 0.1), k * DT, DT)
            assert abs(twist(plant)) < 0.011
        assert plant.state.position[0] == pytest.approx(0.5 * 0.1 / LINK * 0.5**2, abs=1e-3)


def motion(plant: Plant) -> Array:
    """Positions and velocities of links and motors."""
    state = plant.state
    return np.hstack([state.position, state.derivatives[0], state.drivetrain.motor, state.drivetrain.motor_velocity])


def solved(plant: Plant, effort: Array, start: Array, duration: float) -> Array:
    """The motion at the end, by SciPy."""
    n, drives, model, rows = plant.joints, plant.config.drivetrain, plant.config.model, unit_accelerations(plant.joints)
    efforts = np.zeros_like(rows)

    def rate(_t: float, y: Array) -> Array:
        q, dq, motor, speed = (part.copy() for part in y.reshape(4, n))
        inverse_dynamics(model, q, dq, rows, efforts)
        inertia = (efforts[1:] - efforts[0]).T - np.diag(drives.rotor)
        spring = drives.stiffness * (motor - q) + drives.damping * (speed - dq)
        return np.hstack([dq, np.linalg.solve(inertia, spring - efforts[0]), speed, (effort - spring) / drives.rotor])

    return np.asarray(solve_ivp(rate, (0.0, duration), start, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1])


@pytest.mark.parametrize("arm", [PENDULUM, TWO_LINK, PANDA], ids=str)
def test_an_arm_moves_as_scipy_solves_it(arm: Arm) -> None:
    damping = 0.0 if arm is TWO_LINK else 2.0
    plant = plant_of(
        arm, elasticity__stiffness=1e4, elasticity__damping=damping, friction__viscous=0.0, friction__coulomb=0.0
    )
    effort, start = arm.effort(arm.start, ddq=arm.alternating(1.0)), motion(plant)
    for k in range(100):
        plant.step(effort, k * DT, DT)
    expected = solved(plant, effort, start, 0.1)
    assert np.abs(expected[: arm.joints] - start[: arm.joints]).max() > 1e-3
    np.testing.assert_allclose(motion(plant)[: arm.joints], expected[: arm.joints], atol=1e-7)
    np.testing.assert_allclose(motion(plant), expected, atol=2e-5)


@pytest.mark.parametrize("arm", [PENDULUM, TWO_LINK, PANDA], ids=str)
def test_both_engines_twist_the_springs_alike(arm: Arm) -> None:
    loads = {
        "payload__mass": 0.5,
        "payload__time": 0.05,
        "push__effort": 2.0,
        "push__time": 0.1,
        "push__duration": 0.05,
    }
    plants = [
        plant_of(arm, engine=engine, elasticity__stiffness=2e4, elasticity__damping=1.0, **loads)
        for engine in ("rigid_body", "mujoco")
    ]
    twists: list[list[Array]] = [[], []]
    for k in range(200):
        for plant, seen in zip(plants, twists, strict=True):
            plant.step(arm.effort(arm.start) + arm.inertia * math.cos(10.0 * k * DT), k * DT, DT)
            seen.append(plant.state.drivetrain.motor - plant.state.position)
    ours, theirs = np.array(twists)
    assert np.ptp(ours, axis=0).max() > 1e-5
    assert np.abs(theirs - ours).max() < 0.01 * np.ptp(ours, axis=0).max()


_MOTOR_BODY = """<mujoco><option timestep="0.00005" integrator="RK4" gravity="0 0 -9.81"/><worldbody>
<body name="rod" pos="0 0 1"><joint name="swing" axis="0 1 0"/>
<inertial pos="0.4 0 0" mass="4" diaginertia="0.01 0.1 0.1"/></body>
<body name="rotor"><joint name="motor" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="0.2 0.2 0.2"/></body>
</worldbody><tendon><fixed name="spring" stiffness="5000" damping="2" springlength="0">
<joint joint="motor" coef="1"/><joint joint="swing" coef="-1"/></fixed></tendon></mujoco>"""


def test_the_pendulum_moves_as_one_with_a_motor_body_in_mujoco() -> None:
    """A model written by hand, whose motor is a rotor beside the arm."""
    plant = plant_of(PENDULUM, elasticity__stiffness=5000.0, elasticity__damping=2.0)
    model = mujoco.MjModel.from_xml_string(_MOTOR_BODY)
    data = mujoco.MjData(model)
    data.qpos[:] = plant.state.position[0], plant.state.drivetrain.motor[0]
    ours, theirs = [], []
    for k in range(500):
        effort = PENDULUM.effort(PENDULUM.start) + 10.0 * math.cos(20.0 * k * DT)
        plant.step(effort, k * DT, DT)
        data.qfrc_applied[1] = effort[0]
        mujoco.mj_step(model, data, 20)
        ours.append((plant.state.position[0], twist(plant)))
        theirs.append((data.qpos[0], data.qpos[1] - data.qpos[0]))
    for one, other in zip(np.transpose(ours), np.transpose(theirs), strict=True):
        assert np.abs(one - other).max() < 0.01 * np.ptp(other)


@pytest.mark.parametrize("arm", [PENDULUM, TWO_LINK, PANDA], ids=str)
def test_infinite_stiffness_is_the_rigid_arm(arm: Arm) -> None:
    """Under the same torques; the true acceleration of an elastic arm is that of the last period, not of its end."""
    smooth = {"friction__viscous": 0.0, "friction__coulomb": 0.0}
    rigid, stiff = (plant_of(arm, elasticity__stiffness=stiffness, **smooth) for stiffness in (0.0, 1e8))
    moved = 0.0
    for k in range(500):
        effort = arm.effort(arm.start) + arm.inertia * math.cos(10.0 * k * DT)
        for plant in (rigid, stiff):
            plant.step(effort, k * DT, DT)
        moved = max(moved, float(np.abs(rigid.state.position - arm.start).max()))
        assert np.abs(stiff.state.position - rigid.state.position).max() < 1e-6
    assert moved > 0.005


def test_some_joints_can_be_rigid() -> None:
    some = [1e4 if j % 2 else 0.0 for j in range(7)]
    plant = plant_of(PANDA, elasticity__stiffness=some, elasticity__damping=2.0)
    for k in range(100):
        plant.step(PANDA.effort(PANDA.start, ddq=1.0), k * DT, DT)
    twisted = plant.state.drivetrain.motor - plant.state.position
    assert ((twisted != 0.0) == (np.array(some) > 0.0)).all()


def test_the_work_of_the_motors_is_in_the_energy(arm: Arm) -> None:
    """Of motors, springs and links."""
    changes: dict[str, Any] = {"elasticity.stiffness": 1e4, "friction.viscous": 0.0, "friction.coulomb": 0.0}
    plant = plant_of(arm, **{name.replace(".", "__"): value for name, value in changes.items()})
    drives, state, parameters = plant.config.drivetrain, plant.state, plant.config.model.parameters

    def energy() -> float:
        moved = 0.5 * drives.rotor @ (state.drivetrain.motor_velocity**2 - state.derivatives[0] ** 2)
        twisted = 0.5 * drives.stiffness @ (state.drivetrain.motor - state.position) ** 2
        return arm.robot.dynamics.energy(state.position, state.derivatives[0], parameters) + float(moved + twisted)

    work, before = 0.0, energy()
    for k in range(300):
        start = state.drivetrain.motor.copy()
        plant.step(arm.effort(arm.start) + arm.inertia * math.cos(10.0 * k * DT), k * DT, DT)
        work += float(state.effort @ (state.drivetrain.motor - start))
    assert abs(energy() - before) > 1e-3
    assert energy() - before == pytest.approx(work, rel=2e-5)


@pytest.mark.parametrize("engine", ["rigid_body", "mujoco"])
def test_the_encoder_is_on_the_side_that_is_chosen(engine: str) -> None:
    found = {}
    for side in ("motor", "link"):
        settings = {"engine": engine, "elasticity.stiffness": 1e3, "elasticity.encoder": side, "initial_position": 0.3}
        robot = SimulatedRobot(PENDULUM.values(simulator_schema, settings))
        found[side] = robot.sense(0)[1][0]
    assert found["link"] == 0.3
    carried = PENDULUM.effort([0.3])[0]
    assert found["motor"] == pytest.approx(0.3 + carried / 1e3, abs=1e-12)


@pytest.mark.parametrize("engine", ["rigid_body", "mujoco"])
def test_at_rest_the_springs_carry_the_arm(engine: str) -> None:
    plant = plant_of(PANDA, engine=engine, elasticity__stiffness=1e4)
    for k in range(200):
        plant.step(PANDA.effort(PANDA.start), k * DT, DT)
    np.testing.assert_allclose(plant.state.position, PANDA.start, atol=1e-9)


@pytest.mark.parametrize("engine", ["rigid_body", "mujoco"])
def test_brakes_stop_the_motors_and_the_links_swing_on_their_springs(engine: str) -> None:
    settings = {"engine": engine, "elasticity.stiffness": 5e3, "initial_position": 0.3, "command.timeout": 0.005}
    values = PENDULUM.values(simulator_schema, settings)
    robot = SimulatedRobot(values)
    arm, motors, links = robot.state.arm, [], []
    for k in range(300):
        robot.sense(k)
        robot.act(k, k < 100, PENDULUM.effort([0.3], ddq=3.0))
        motors.append(arm.drivetrain.motor[0])
        links.append(arm.position[0])
    assert robot.braked
    assert motors[100] - motors[0] > 0.01
    assert np.ptp(motors[200:]) < 1e-9
    assert np.ptp(links[200:]) > 1e-5
    robot.reset(values)
    assert arm.position.tolist() == [0.3]
    assert (arm.derivatives == 0.0).all()
    assert arm.drivetrain.motor_velocity.tolist() == [0.0]
    assert arm.drivetrain.motor[0] == pytest.approx(0.3 + PENDULUM.effort([0.3])[0] / 5e3, abs=1e-12)


@pytest.mark.parametrize(
    ("arm", "changes", "words"),
    [
        (PENDULUM, {"robot__armature": 0.0}, "swing has no rotor.*robot.armature"),
        (TWO_LINK, {"robot__m2": 0.0}, "joint2 moves nothing but its rotor"),
    ],
    ids=["rotor", "link"],
)
def test_a_joint_that_cannot_be_elastic_is_refused_with_the_cure(arm: Arm, changes: dict[str, Any], words: str) -> None:
    plant_of(arm, **changes)
    with pytest.raises(ParameterError, match=words):
        plant_of(arm, elasticity__stiffness=1e4, **changes)


def test_mujoco_refuses_what_takes_too_many_steps() -> None:
    with pytest.raises(ParameterError, match="rigid_body"):
        plant_of(PENDULUM, engine="mujoco", elasticity__stiffness=1e12)


def test_where_absurd_friction_leaves_nothing_to_divide_by_the_arm_has_diverged() -> None:
    absurd = {
        "friction.coulomb": 1e12,
        "friction.cogging": 1e12,
        "friction.load": 1e-12,
        "friction.bristle_stiffness": 1e4,
    }
    with pytest.raises(DivergedError):
        rollout(simulator=absurd, duration=0.02)
