"""Current loops: when they take a command, in which steps, and how fast the torque follows."""

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim
from support.testarms import PENDULUM

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.simulation.current_loop import current_loop_config, current_loop_state, follow
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema

DT = 0.001


def torques(command: Array, **changes: object) -> tuple[Array, Array]:
    """Torques at the end of each sample, and their means, shape (samples,); names without the group ``actuator``."""
    chosen = {f"actuator.{name}": value for name, value in changes.items()}
    config = current_loop_config(PENDULUM.values(simulator_schema, chosen), 1)
    state, ends, means = current_loop_state(1), [], []
    for each in command:
        follow(config, state, np.full(1, each))
        ends.append(state.torque[0])
        means.append(state.mean[0])
    return np.array(ends), np.array(means)


@pytest.mark.parametrize(("frequency", "damping"), [(300.0, 0.7), (3000.0, 0.3), (500.0, 1.0), (200.0, 2.0)])
def test_the_loop_is_that_of_second_order(frequency: float, damping: float) -> None:
    """Judged by SciPy, on a grid of 100 points in a sample."""
    command = np.repeat([10.0, -5.0, 3.0], 10)
    ends, means = torques(command, frequency=frequency, damping=damping)
    system = StateSpace(
        [[0.0, 1.0], [-(frequency**2), -2.0 * damping * frequency]], [[0.0], [frequency**2]], [[1.0, 0.0]], [[0.0]]
    )
    fine = np.repeat(command, 100)
    _, y, _ = lsim(system, np.append(fine, fine[-1]), np.arange(fine.size + 1) * DT / 100, interp=False)
    np.testing.assert_allclose(ends, y[100::100], atol=1e-9)
    np.testing.assert_allclose(means, (0.5 * (y[1:] + y[:-1])).reshape(-1, 100).mean(axis=1), atol=5e-3)


def test_a_command_is_rounded_to_its_steps() -> None:
    _, means = torques(np.array([0.0, 0.24, 0.26, -0.76, 1.0]), resolution=0.5)
    assert means.tolist() == [0.0, 0.0, 0.5, -1.0, 1.0]


@pytest.mark.parametrize(("rate", "taken"), [(1000.0, 1), (500.0, 2), (250.0, 4)])
def test_a_slower_drive_holds_the_command_that_it_took_last(rate: float, taken: int) -> None:
    command = np.arange(1.0, 41.0)
    _, means = torques(command, rate=rate)
    assert means.tolist() == command[np.arange(40) // taken * taken].tolist()


def test_a_rate_that_is_no_fraction_keeps_its_mean() -> None:
    _, means = torques(np.arange(1.0, 1001.0), rate=400.0)
    assert np.unique(means).size == 400


def test_a_drive_faster_than_the_simulator_is_refused() -> None:
    with pytest.raises(ParameterError, match="1000 Hz of the simulator"):
        torques(np.zeros(1), rate=2000.0)


def test_the_reported_effort_has_offset_and_noise() -> None:
    settings = {"effort_sensor.offset": 0.5, "effort_sensor.noise": 0.1, "seed": 1}
    robot, found = SimulatedRobot(PENDULUM.values(simulator_schema, settings)), []
    for k in range(1000):
        robot.sense(k)
        found.append(robot.applied[0] - robot.state.arm.effort[0])
        robot.act(k, True, np.full(1, 2.0))
    assert np.mean(found) == pytest.approx(0.5, abs=0.02)
    assert np.std(found) == pytest.approx(0.1, rel=0.1)


def test_an_effort_sensor_on_the_link_measures_what_reaches_it() -> None:
    """At rest, friction keeps a part of the torque of the motor."""
    settings = {
        "effort_sensor.side": "link",
        "elasticity.stiffness": 1e4,
        "elasticity.damping": 20.0,
        "friction.coulomb": 5.0,
        "friction.bristle_stiffness": 1e5,
        "initial_position": 0.3,
    }
    robot = SimulatedRobot(PENDULUM.values(simulator_schema, settings))
    carried = PENDULUM.effort([0.3])
    for k in range(500):
        robot.sense(k)
        robot.act(k, True, carried + 2.0)
    assert robot.state.arm.effort[0] == pytest.approx(carried[0] + 2.0)
    assert robot.applied[0] == pytest.approx(carried[0], rel=1e-3)
