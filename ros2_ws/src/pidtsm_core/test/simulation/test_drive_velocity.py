"""The velocity that drives report follows the motion with the lag of its filter, and never jumps."""

import math

import numpy as np
import pytest

from pidtsm_core.simulation.drive_velocity import DriveVelocity

CUTOFF = 600.0  # rad/s


@pytest.mark.parametrize("period", [0.001, 0.002, 0.01])
def test_a_steady_motion_is_known_at_every_rate(period: float) -> None:
    drives = DriveVelocity(2, CUTOFF)
    for k in range(200):
        drives.measure(k * period, np.array([0.5, -2.0]) * k * period)
    assert drives.velocity == pytest.approx([0.5, -2.0])


def test_it_lags_by_the_inverse_of_the_cutoff() -> None:
    drives, period, acceleration = DriveVelocity(1, CUTOFF), 1e-4, 3.0
    for k in range(2001):
        drives.measure(k * period, np.array([0.5 * acceleration * (k * period) ** 2]))
    lag = 0.2 - drives.velocity[0] / acceleration
    assert lag == pytest.approx(1.0 / CUTOFF, abs=period)


def test_it_begins_at_rest_and_a_jump_of_the_arm_is_no_motion() -> None:
    drives = DriveVelocity(1, CUTOFF)
    drives.measure(0.0, np.array([1.0]))
    assert drives.velocity == [0.0]
    drives.measure(0.001, np.array([1.001]))
    moving = drives.velocity[0]
    assert moving == pytest.approx(1.0 - math.exp(-0.6))
    drives.measure(0.001, np.array([1.001]))  # sent again
    assert drives.velocity == [moving]
    drives.reset()
    drives.measure(0.002, np.array([-5.0]))
    assert drives.velocity == [0.0]
    drives.measure(0.003, np.array([-5.0]))
    assert drives.velocity == [0.0]
