"""Effects of a drive on a command."""

import math

import numpy as np
import pytest
from support.testarms import Arm

from pidtsm_core.arrays import Array
from pidtsm_core.simulation.actuator import actuator_config, drive
from pidtsm_core.simulation.randomness import Randomness, columns
from pidtsm_core.simulation.simulator import simulator_schema

DT = 0.001


def torques(arm: Arm, command: Array, q: Array | None = None, draws: Array | None = None, **changes: object) -> Array:
    """Torque of every sample, shape as `command`, (samples, joints); names without the group ``actuator``."""
    rows = np.zeros((len(command), columns(arm.joints))) if draws is None else draws
    chosen = {f"actuator.{name}": value for name, value in changes.items()}
    config = actuator_config(arm.values(simulator_schema, chosen), arm.joints)
    lagging, effort = np.zeros(arm.joints), np.empty_like(command)
    for k in range(len(command)):
        drive(config, lagging, command[k], np.zeros(arm.joints) if q is None else q[k], rows[k], effort[k])
    return effort


def random_command(arm: Arm) -> Array:
    return np.random.default_rng(1).normal(0.0, 0.5, (100, arm.joints)) * arm.limits


def test_an_ideal_drive_obeys(arm: Arm) -> None:
    command = random_command(arm)
    np.testing.assert_array_equal(torques(arm, command), command)


@pytest.mark.parametrize("lag", [1e-4, 0.001, 0.01])
def test_the_lag_is_of_first_order_and_keeps_the_momentum(arm: Arm, lag: float) -> None:
    samples, command = 200, arm.alternating(10.0) * arm.spread(1.0, 0.4)
    # A drive with lag, the next one without, and so on.
    lags = np.resize([lag, 0.0], arm.joints)
    effort = torques(arm, np.tile(command, (samples, 1)), lag=lags.tolist())
    end = DT * np.arange(1, samples + 1)
    # The integral of 1 - exp(-t / T).
    momentum = end - lag * (1.0 - np.exp(-end / lag))
    for j in range(arm.joints):
        if lags[j]:
            np.testing.assert_allclose(np.cumsum(effort[:, j]) * DT, command[j] * momentum, rtol=1e-12)
        else:
            np.testing.assert_array_equal(effort[:, j], command[j])


def test_the_dead_zone_takes_its_width(arm: Arm) -> None:
    command, widths = np.outer(np.linspace(-3.0, 3.0, 601), arm.alternating(1.0)), arm.spread(1.0, 0.5)
    effort = torques(arm, command, dead_zone=widths)
    for j, width in enumerate(widths):
        outside = np.abs(command[:, j]) > width
        assert not effort[~outside, j].any()
        np.testing.assert_allclose(np.abs(effort[outside, j]), np.abs(command[outside, j]) - width, atol=1e-12)
        assert (np.sign(effort[outside, j]) == np.sign(command[outside, j])).all()


def test_the_torque_constant_is_off_by_its_error(arm: Arm) -> None:
    command, error = random_command(arm), arm.spread(0.05, -0.1)
    np.testing.assert_allclose(torques(arm, command, torque_constant_error=error), command * (1.0 + np.array(error)))


def test_ripple_repeats_with_the_angle(arm: Arm) -> None:
    q = np.ones((721, arm.joints))
    q[:, 0] = np.linspace(0.0, 2.0 * math.pi, 721)
    periods = [6, *[4] * (arm.joints - 1)]
    effort = torques(arm, np.full((721, arm.joints), 20.0), q, ripple=0.02, ripple_periods=periods)
    np.testing.assert_allclose(effort[:, 0], 20.0 * (1.0 + 0.02 * np.sin(6.0 * q[:, 0])))
    assert np.ptp(effort[:, 0]) == pytest.approx(2.0 * 20.0 * 0.02, rel=1e-3)
    assert not np.ptp(effort[:, 1:], axis=0).any()


def test_noise_is_added_with_its_standard_deviation(arm: Arm) -> None:
    command, deviations = np.zeros((20_000, arm.joints)), arm.spread(0.5, 0.0)
    values = arm.values(simulator_schema, {"actuator.noise": deviations, "noise.std": 1e-3})
    effort = torques(arm, command, draws=Randomness(values, arm.joints).draw(len(command)), noise=deviations)
    np.testing.assert_allclose(effort.mean(axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose(effort.std(axis=0), deviations, rtol=0.05, atol=1e-15)
