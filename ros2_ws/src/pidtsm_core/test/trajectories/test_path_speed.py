"""The highest speed on a path."""

import math

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.trajectories.path_speed import path_speed


def speeds(slopes: Array, bends: Array, highest: float, acceleration: Array) -> tuple[Array, Array]:
    """Grid and speeds along the path."""
    grid, squared = np.linspace(0.0, 1.0, len(slopes)), np.full(len(slopes), np.nan)
    path_speed(grid, slopes, bends, np.full(len(slopes), highest), acceleration, squared)
    return grid, np.sqrt(squared)


def test_on_a_straight_line_it_accelerates_and_decelerates_at_the_limit() -> None:
    slopes = np.tile([2.0, -0.5], (401, 1))
    for highest in (math.inf, 1.0):
        grid, speed = speeds(slopes, np.zeros_like(slopes), highest, np.array([3.0, 9.0]))
        expected = np.minimum(np.sqrt(2.0 * 1.5 * np.minimum(grid, 1.0 - grid)), math.sqrt(highest))
        np.testing.assert_allclose(speed, expected, atol=1e-6)


def test_in_a_curve_no_joint_exceeds_its_acceleration() -> None:
    angle = np.linspace(0.0, 6.0, 1001)
    slopes = 6.0 * np.array([-np.sin(angle), np.cos(angle)]).T
    bends = 36.0 * np.array([-np.cos(angle), -np.sin(angle)]).T
    acceleration = np.array([2.0, 1.0])
    grid, speed = speeds(slopes, bends, math.inf, acceleration)
    along = np.diff(speed**2) / np.diff(grid) / 2.0
    joints = slopes[:-1] * along[:, None] + bends[:-1] * speed[:-1, None] ** 2
    assert (np.abs(joints) <= acceleration * (1.0 + 1e-6)).all()
    assert speed[1:-1].min() > 0.0
    assert np.mean((np.abs(joints) > 0.99 * acceleration).any(axis=1)) > 0.95
