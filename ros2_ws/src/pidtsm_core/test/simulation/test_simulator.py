"""The whole simulated robot: arrival times, brakes, and the same bits in a node and in a rollout."""

from typing import Any

import numpy as np
import pytest
from support.testarms import Arm, dotted

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.experiment.definition import MEASUREMENT
from pidtsm_core.parameters import ParameterError, resolve
from pidtsm_core.recording import Recording
from pidtsm_core.references import ReferenceMotion, reference_schema
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Signal
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema
from pidtsm_core.timing import seconds

EVERYTHING: dict[str, Any] = {
    "encoder.bits": 16,
    "encoder.bias": 1e-4,
    "noise.std": 1e-5,
    "backlash.gap": 1e-4,
    "jitter.std": 1e-5,
    "delay.samples": 2,
    "delay.command_samples": 1,
    "dropout.probability": 0.05,
    "dropout.burst": 10,
    "dropout.burst_rate": 2.0,
    "dropout.command_probability": 0.05,
    "dropout.command_burst": 5,
    "dropout.command_burst_rate": 2.0,
    "actuator.dead_zone": 0.1,
    "actuator.lag": 0.004,
    "actuator.torque_constant_error": 0.03,
    "actuator.ripple": 0.02,
    "actuator.noise": 0.01,
    "friction.coulomb": 1.0,
    "friction.static": 1.5,
    "friction.viscous": 0.2,
    "model_error.mass": 0.1,
    "model_error.inertia": -0.1,
    "model_error.length": 0.01,
    "payload.mass": 0.2,
    "payload.time": 0.2,
    "push.effort": 5.0,
    "push.time": 0.3,
    "push.duration": 0.1,
    "seed": 3,
}
PER_JOINT = ("encoder.bias", "push.effort")
MS = 1_000_000
CALM = {"estimator.velocity_cutoff": 50.0, "law.upsilon": 1.0}


def of(arm: Arm, effects: dict[str, Any]) -> dict[str, Any]:
    """Effects on an arm; some of them differ between the joints."""
    return {n: arm.spread(v, -0.5 * v) if n in PER_JOINT else v for n, v in effects.items()}


def run(arm: Arm, simulator: dict[str, Any], duration: float = 0.5) -> Recording:
    settings = arm.motion()
    settings["controller"] |= CALM
    settings["simulator"] |= of(arm, simulator)
    return rollout(**settings, duration=duration)


def robot_of(arm: Arm, **changes: object) -> SimulatedRobot:
    """A simulated robot; parameter names with two underscores instead of the dot."""
    return SimulatedRobot(arm.values(simulator_schema, dotted(changes)))


@pytest.mark.parametrize(
    "simulator",
    [{}, EVERYTHING, {"delay.samples": 3}, {"actuator.lag": 0.01}],
    ids=["ideal", "everything", "delay", "lag"],
)
def test_stepping_the_robot_as_the_node_does_gives_the_bits_of_the_rollout(arm: Arm, simulator: dict[str, Any]) -> None:
    whole, settings = run(arm, simulator), arm.motion()
    robot = SimulatedRobot(arm.values(simulator_schema, {**settings["simulator"], **of(arm, simulator)}))
    controller = Controller(arm.values(controller_schema, {**MEASUREMENT.defaults["controller"], **CALM}))
    motion = ReferenceMotion(resolve(reference_schema, {"joints": arm.names, **settings["trajectory"]}, arm.joints))
    begun, moving = -1, robot.state.arm
    for k in range(len(whole.time)):
        assert whole.position[k].tobytes() == moving.position.tobytes(), k
        assert whole.velocity[k].tobytes() == moving.derivatives[0].tobytes(), k
        acquired, measured = robot.sense(k)
        if acquired >= 0:
            begun = acquired if begun < 0 else begun
            motion.evaluate(seconds((acquired - begun) * MS), controller.reference)
            controller.position[:] = measured
            status = controller.step(acquired * MS, acquired * MS)
            assert whole.signals[acquired].tobytes() == controller.signals.tobytes(), k
            assert whole.status[acquired].tolist() == list(status), k
        robot.act(k, acquired >= 0, controller.effort)
        assert whole.effort[k].tobytes() == moving.effort.tobytes(), k


@pytest.mark.parametrize("name", [n for n in EVERYTHING if n not in ("seed", "dropout.burst", "dropout.command_burst")])
def test_every_effect_is_off_by_default_and_does_something(arm: Arm, name: str) -> None:
    on = {name: EVERYTHING[name]}
    if name.startswith(("payload", "push")):
        on = {n: v for n, v in EVERYTHING.items() if n.startswith(name.split(".", maxsplit=1)[0])}
    assert run(arm, on).position.tobytes() != run(arm, {}).position.tobytes()


def test_the_seed_decides(arm: Arm) -> None:
    first, again, other = run(arm, EVERYTHING), run(arm, EVERYTHING), run(arm, {**EVERYTHING, "seed": 4})
    assert first.position.tobytes() == again.position.tobytes()
    assert first.position.tobytes() != other.position.tobytes()
    assert run(arm, {"seed": 4}).position.tobytes() == run(arm, {}).position.tobytes(), "nothing is random by default"


@pytest.mark.parametrize("measurement", [0, 3])
@pytest.mark.parametrize("command", [0, 2])
def test_the_arm_stands_on_its_brakes_until_a_command_has_come_all_the_way(
    arm: Arm, measurement: int, command: int
) -> None:
    delayed = run(arm, {"delay.samples": measurement, "delay.command_samples": command}, 0.1)
    waiting = measurement + command
    assert not delayed.effort[:waiting].any()
    assert (delayed.position[: waiting + 1] == delayed.position[0]).all()
    assert delayed.effort[waiting].all()
    # Row k of the signals was computed from sample k, whenever that arrived.
    computed = delayed.signals[: len(delayed.time) - waiting, Signal.EFFORT]
    np.testing.assert_array_equal(delayed.effort[waiting:], computed)
    np.testing.assert_array_equal(delayed.signals[-measurement - 1 :], delayed.signals[[-1] * (measurement + 1)])


def pushing(arm: Arm) -> Array:
    """A torque that pushes every joint away from rest."""
    return arm.effort(arm.robot.initial_position, ddq=arm.alternating(8.0))


@pytest.mark.parametrize("lag", [0.0, 0.01])
def test_brakes_stop_the_arm_without_a_jump_until_the_next_command(arm: Arm, lag: float) -> None:
    robot, effort = robot_of(arm, actuator__lag=lag, command__timeout=0.001), pushing(arm)
    moving = robot.state.arm
    for k in range(100):
        robot.sense(k)
        robot.act(k, True, effort)
    velocity = moving.derivatives[0].copy()
    assert np.abs(velocity).min() > 0.1
    for k in range(100, 140):
        before, speed = moving.position.copy(), np.abs(moving.derivatives[0]).copy()
        robot.sense(k)
        robot.act(k, False, effort)
        assert (np.abs(moving.position - before) <= speed * 1e-3).all()
        assert not moving.effort.any()
    assert np.abs(moving.derivatives).max() < 1e-4
    robot.sense(140)
    robot.act(140, True, effort)
    assert np.abs(moving.effort).min() > 0.0
    assert np.abs(moving.derivatives[0]).min() > 1e-4


def test_what_is_on_its_way_still_arrives_after_the_brakes_are_closed(arm: Arm) -> None:
    robot = robot_of(arm, delay__command_samples=3, command__timeout=0.001)
    for k in range(10):
        robot.sense(k)
        robot.act(k, True, 0.3 * arm.limits)
    moved = []
    for k in range(10, 16):
        robot.sense(k)
        robot.act(k, False, np.zeros(arm.joints))
        moved.append(bool(robot.state.arm.effort.any()))
    assert moved == [True] * 3 + [False] * 3


def test_a_reset_arm_is_where_it_began_and_moves_as_it_did(arm: Arm) -> None:
    changes = {"backlash.gap": 1e-3, "actuator.lag": 0.005, "initial_position": arm.start}
    values = arm.values(simulator_schema, changes)
    robot, effort = SimulatedRobot(values), 0.3 * arm.limits
    motions: list[list[bytes]] = []
    for start in (0, 50):
        motions.append([])
        for k in range(start, start + 50):
            _, measured = robot.sense(k)
            motions[-1].append(measured.tobytes())
            robot.act(k, True, effort)
        robot.reset(values)
    np.testing.assert_array_equal(robot.state.arm.position, arm.start)
    assert not robot.state.arm.derivatives.any()
    assert motions[0] == motions[1]


def test_a_measurement_arrives_with_its_sample_after_the_delay(arm: Arm) -> None:
    robot = robot_of(arm, delay__samples=2)
    positions = []
    for k in range(50):
        positions.append(robot.state.arm.position.copy())
        acquired, measured = robot.sense(k)
        assert acquired == (k - 2 if k >= 2 else -1)
        if acquired >= 0:
            np.testing.assert_array_equal(measured, positions[acquired])
        robot.act(k, True, 0.3 * arm.limits)


def test_a_lost_command_leaves_the_torque_as_it_was(arm: Arm) -> None:
    robot = robot_of(arm, dropout__command_probability=0.3)
    efforts: list[Array] = []
    for k in range(200):
        robot.sense(k)
        robot.act(k, True, 0.01 * (k + 1) * arm.limits)
        efforts.append(robot.state.arm.effort.copy())
    got = np.array(efforts)
    sent = np.outer(np.minimum(0.01 * np.arange(1.0, 201.0), 1.0), arm.limits)
    late = ~np.isclose(got, sent, rtol=1e-12)
    assert (late == late[:, [0] * arm.joints]).all(), "all joints at once"
    assert 0.15 < late[:99, 0].mean() < 0.45
    np.testing.assert_array_equal(got[1:][late[1:]], got[:-1][late[1:]])


def test_if_everything_is_lost_the_arm_does_not_move(arm: Arm) -> None:
    dead = run(arm, {"dropout.probability": 1.0}, 0.1)
    assert not dead.effort.any()
    assert not dead.signals.any()
    assert (dead.position == dead.position[0]).all()


def test_new_parameters_count_from_the_next_sample_on(arm: Arm) -> None:
    """This also holds for a robot that was ideal before; it keeps its present torque."""
    robot = robot_of(arm)
    effort = 0.3 * arm.limits
    robot.sense(0)
    robot.act(0, True, effort)
    bias = arm.spread(0.5, -0.5)
    robot.set_parameters(arm.values(simulator_schema, {"dropout.command_probability": 1.0, "encoder.bias": bias}))
    acquired, measured = robot.sense(1)
    assert acquired == 1
    np.testing.assert_array_equal(measured, robot.state.arm.position + bias)
    robot.act(1, True, effort * 2.0)
    np.testing.assert_array_equal(robot.state.arm.effort, effort)


@pytest.mark.parametrize("lost", ["dropout.command_", "dropout."], ids=["commands", "measurements"])
def test_brakes_hold_the_arm_while_commands_stay_out_for_too_long(arm: Arm, lost: str) -> None:
    """Commands may be missing because they are lost, or because the controller receives no measurement."""
    braked = run(arm, {"command.timeout": 0.05, f"{lost}time": 0.5, f"{lost}duration": 0.2}, 1.0)
    torque = np.abs(braked.effort).max(axis=1)
    # The last torque is held for the timeout, counted from the sample of the last command.
    np.testing.assert_array_equal(braked.effort[500:549], braked.effort[[499] * 49])
    assert not torque[549:700].any()
    assert np.abs(braked.velocity[580:700]).max() < 1e-5
    assert (torque[700:] > 0.0).all()
    assert np.abs(braked.velocity[-1]).max() > 1e-3


def test_without_a_timeout_the_last_torque_is_held_for_ever(arm: Arm) -> None:
    held = run(arm, {"command.timeout": 0.0, "dropout.time": 0.1, "dropout.duration": 2.0}, 1.0)
    np.testing.assert_array_equal(held.effort[100:], held.effort[[99] * 900])


def test_the_limits_stand_after_the_drives(arm: Arm) -> None:
    robot = robot_of(arm, actuator__torque_constant_error=0.5)
    for k, share in enumerate((0.9, -0.9)):
        robot.sense(k)
        robot.act(k, True, share * arm.limits)
        np.testing.assert_array_equal(robot.state.arm.effort, np.sign(share) * arm.limits)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("encoder.bits", -1),
        ("encoder.bits", 12.5),
        ("noise.std", -1e-3),
        ("noise.std", [1.0] * 5),
        ("jitter.std", -1e-6),
        ("backlash.gap", -0.1),
        ("delay.samples", -1),
        ("delay.command_samples", 0.5),
        ("dropout.probability", 1.1),
        ("dropout.command_probability", -0.1),
        ("dropout.burst", 0),
        ("dropout.burst_rate", -1.0),
        ("actuator.lag", -1.0),
        ("actuator.ripple", 2.0),
        ("actuator.dead_zone", -1.0),
        ("actuator.torque_constant_error", -2.0),
        ("friction.coulomb", -1.0),
        ("friction.stribeck_velocity", 0.0),
        ("model_error.mass", -1.0),
        ("push.duration", -1.0),
        ("seed", -1),
    ],
)
def test_invalid_values_are_refused(arm: Arm, name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=name):
        arm.values(simulator_schema, {name: value})


@pytest.mark.parametrize("engine", ["rigid_body", "mujoco"])
def test_an_arm_that_is_too_fast_for_its_step_diverges_and_moves_as_new_after_a_reset(engine: str) -> None:
    values = resolve(simulator_schema, {"engine": engine, "rate": 100, "limits.effort": 1e6}, 2)
    new, robot = SimulatedRobot(values), SimulatedRobot(values)
    samples = iter(range(10_000))
    while not robot.diverged:
        sample = next(samples)
        robot.sense(sample)
        robot.act(sample, True, 1e6 * np.sign(robot.state.arm.derivatives[0] + 0.1))
    robot.reset(values)
    assert not robot.diverged
    for each in (new, robot):
        for sample in range(20_000, 20_010):
            each.sense(sample)
            each.act(sample, True, np.array([1.0, 0.5]))
    assert robot.state.arm.position.tobytes() == new.state.arm.position.tobytes()
