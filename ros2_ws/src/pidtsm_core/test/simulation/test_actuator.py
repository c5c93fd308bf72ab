"""Effects of a drive on a command."""

import math

import numpy as np
import pytest

from pidtsm_core.parameters import Array, resolve
from pidtsm_core.simulation.actuator import actuator_config, drive
from pidtsm_core.simulation.simulator import simulator_schema

DT = 0.001


def torques(command: Array, q: Array | None = None, **changes: object) -> Array:
    """Torque of every sample, shape as `command`, (samples, joints); names without the group ``actuator``."""
    chosen = {f"actuator.{name}": value for name, value in changes.items()}
    config = actuator_config(resolve(simulator_schema, chosen, 2), 2)
    lagging, effort = np.zeros(2), np.empty_like(command)
    for k in range(len(command)):
        drive(config, lagging, command[k], np.zeros(2) if q is None else q[k], effort[k])
    return effort


def test_an_ideal_drive_obeys() -> None:
    command = np.random.default_rng(1).normal(0.0, 50.0, (100, 2))
    np.testing.assert_array_equal(torques(command), command)


@pytest.mark.parametrize("lag", [1e-4, 0.001, 0.01])
def test_the_lag_is_of_first_order_and_keeps_the_momentum(lag: float) -> None:
    samples = 200
    effort = torques(np.tile([10.0, -4.0], (samples, 1)), lag=[lag, 0.0])
    end = DT * np.arange(1, samples + 1)
    # The integral of 1 - exp(-t / T).
    momentum = 10.0 * (end - lag * (1.0 - np.exp(-end / lag)))
    np.testing.assert_allclose(np.cumsum(effort[:, 0]) * DT, momentum, rtol=1e-12)
    np.testing.assert_array_equal(effort[:, 1], -4.0)


def test_the_dead_zone_takes_its_width() -> None:
    command = np.linspace([-3.0, 3.0], [3.0, -3.0], 601)
    effort = torques(command, dead_zone=[1.0, 0.5])
    for j, width in enumerate((1.0, 0.5)):
        outside = np.abs(command[:, j]) > width
        assert not effort[~outside, j].any()
        np.testing.assert_allclose(np.abs(effort[outside, j]), np.abs(command[outside, j]) - width, atol=1e-12)
        assert (np.sign(effort[outside, j]) == np.sign(command[outside, j])).all()


def test_the_torque_constant_is_off_by_its_error() -> None:
    command = np.random.default_rng(1).normal(0.0, 50.0, (100, 2))
    np.testing.assert_allclose(torques(command, torque_constant_error=[0.05, -0.1]), command * [1.05, 0.9])


def test_ripple_repeats_with_the_angle() -> None:
    q = np.linspace([0.0, 1.0], [2.0 * math.pi, 1.0], 721)
    effort = torques(np.full((721, 2), 20.0), q, ripple=0.02, ripple_periods=[6, 4])
    np.testing.assert_allclose(effort[:, 0], 20.0 * (1.0 + 0.02 * np.sin(6.0 * q[:, 0])))
    assert np.ptp(effort[:, 0]) == pytest.approx(2.0 * 20.0 * 0.02, rel=1e-3)
    assert np.ptp(effort[:, 1]) == 0.0
