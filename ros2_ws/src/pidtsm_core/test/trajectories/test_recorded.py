"""Motions from recorded positions, judged by the motion that was recorded."""

import numpy as np
import pytest

from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import motion_limits
from pidtsm_core.trajectories.recorded import beyond_range, largest_effort, recorded_motion, share_of_velocity

JOINTS = ("joint1", "joint2")
STEP = 2.0 * np.pi / 2**14
"""Of an encoder, rad."""


@pytest.mark.parametrize("rate", [100.0, 1000.0])
@pytest.mark.parametrize("speed", [0.5, 1.0, 2.0])
def test_the_steps_of_an_encoder_and_irregular_times_are_smoothed(rate: float, speed: float) -> None:
    random = np.random.default_rng(0)
    time = np.cumsum(random.uniform(0.5, 1.5, int(4.0 * rate))) / rate
    w = np.array([1.0, 3.0])

    measured = np.round(0.5 * np.sin(np.outer(time, w)) / STEP) * STEP
    motion = recorded_motion(JOINTS, time, measured, speed)
    assert motion.duration == pytest.approx((time[-1] - time[0]) / speed, abs=0.02)
    at = time[0] + motion.time * speed
    inner = slice(10, -10)  # The filter knows less at the ends.
    np.testing.assert_allclose(motion.position, 0.5 * np.sin(np.outer(at, w)), atol=2e-3)
    true = 0.5 * w * speed * np.cos(np.outer(at, w))
    np.testing.assert_allclose(motion.velocity[inner], true[inner], atol=0.05)


def test_limits_are_those_of_the_arm() -> None:
    time = np.linspace(0.0, 2.0, 401)
    motion = recorded_motion(JOINTS, time, np.outer(np.sin(time), [1.0, 0.5]))
    settings = {"joints": list(JOINTS), "robot.description": "two_link", "limits.velocity": [2.0, 0.25]}
    limits = motion_limits(settings)
    assert share_of_velocity(motion, limits).max() == pytest.approx(0.5 / (0.95 * 0.25), rel=0.01)
    assert not beyond_range(motion, limits)
    narrow = motion_limits({**settings, "limits.min_position": [-2.0, -0.4], "limits.max_position": [2.0, 0.4]})
    assert beyond_range(motion, narrow).startswith("joint2 moves from")
    # At rest, stretched out horizontally, gravity takes most: 9.8 (m1 l1 + m2 (l1 + l2)) and 9.8 m2 l2.
    still = recorded_motion(JOINTS, time, np.zeros((401, 2)))
    found = largest_effort(still, limits)
    assert found is not None
    np.testing.assert_allclose(found, [9.8 * (0.5 * 1.0 + 1.5 * 1.85), 9.8 * 1.5 * 0.85], rtol=1e-6)


def test_a_motion_that_is_too_short_is_refused() -> None:
    with pytest.raises(TrajectoryError, match=r"at least 0\.2 s"):
        recorded_motion(JOINTS, np.array([0.0, 0.1]), np.zeros((2, 2)))
    with pytest.raises(TrajectoryError, match=r"at least 0\.2 s"):
        recorded_motion(JOINTS, np.zeros(0), np.zeros((0, 2)))
