"""Coming to rest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.arrays import Array
from pidtsm_core.trajectories.limits import MotionLimits, motion_limits
from pidtsm_core.trajectories.motion import PiecewiseMotion
from pidtsm_core.trajectories.stopping import stop, stop_at


def states(motion: PiecewiseMotion, times: Array) -> Array:
    """Shape (times, 3, joints)."""
    result = np.empty((times.size, 3, motion.parameters.shape[0]))
    for t, state in zip(times, result, strict=True):
        motion.evaluate(float(t), state)
    return result


@settings(max_examples=100)
@given(seed=st.integers(0, 2**32 - 1), joints=st.integers(1, 7), excess=st.floats(0.0, 2.0))
def test_it_is_smooth_within_limits_and_as_fast_as_they_allow(seed: int, joints: int, excess: float) -> None:
    random = np.random.default_rng(seed)
    acceleration, jerk = random.uniform(0.5, 20.0, joints), random.uniform(5.0, 500.0, joints)
    limits = motion_limits(
        {
            "joints": [f"joint{j}" for j in range(joints)],
            "limits.acceleration": acceleration.tolist(),
            "limits.jerk": jerk.tolist(),
        }
    )
    present = random.uniform(-1.0, 1.0, (3, joints)) * [[2.0], [3.0], [excess]]
    present[2] *= acceleration
    motion = stop(present, limits)
    times = np.linspace(0.0, motion.end, 400)
    path = states(motion, times)
    np.testing.assert_allclose(path[0], present, atol=1e-12)
    assert (np.abs(path[:, 2]) <= np.maximum(acceleration, np.abs(present[2])) + 1e-9).all()
    steps = np.diff(path[:, 2], axis=0)[:-1]  # Behind the last state the acceleration is exactly zero.
    assert (np.abs(steps) <= jerk * (times[1] - times[0]) * (1.0 + 1e-6) + 1e-9).all()
    # Joints decelerate at their limits: from velocity v, after the acceleration has come to zero with velocity w.
    ramp = np.abs(present[2]) / jerk
    w = np.abs(present[1] + 0.5 * present[2] * ramp)
    slowest = ramp + w / acceleration + acceleration / jerk + np.sqrt(w / jerk)
    assert motion.end <= slowest.max() + 1e-9
    end = states(motion, np.array([motion.end, motion.end + 5.0]))
    assert not end[:, 1:].any()
    np.testing.assert_array_equal(end[0], end[1])


def test_a_joint_that_does_not_accelerate_never_turns_back(limits: MotionLimits) -> None:
    joints = len(limits.joints)
    velocity = np.resize([0.8, -0.5], joints) * np.minimum(limits.velocity, 2.0)
    motion = stop(np.array([np.zeros(joints), velocity, np.zeros(joints)]), limits)
    path = states(motion, np.linspace(0.0, motion.end, 500))
    assert (path[:, 1] * np.sign(velocity) >= -1e-12).all()
    pure = velocity**2 / (2.0 * limits.acceleration)
    ramp = limits.acceleration / limits.jerk
    assert (np.abs(path[-1, 0]) <= pure + 0.5 * np.abs(velocity) * ramp + 1e-9).all()


def test_an_arm_at_rest_stays_there(limits: MotionLimits) -> None:
    present = np.zeros((3, len(limits.joints)))
    present[0] = 0.1
    for t in (0.0, 1.0):
        np.testing.assert_array_equal(states(stop(present, limits), np.array([t]))[0], present)


@pytest.mark.parametrize("derivative", [1, 2])
@pytest.mark.parametrize("absurd", [1e7, 5e12])  # Would last for hours; is refused by ruckig.
def test_an_absurd_motion_comes_to_rest_too(limits: MotionLimits, derivative: int, absurd: float) -> None:
    present = np.zeros((3, len(limits.joints)))
    present[0], present[derivative] = 0.5, absurd
    desired = np.empty_like(present)
    motion = stop(present, limits)
    motion.evaluate(0.0, desired)
    np.testing.assert_array_equal(desired[0], present[0])
    motion.evaluate(motion.end, desired)
    assert np.isfinite(desired).all()
    assert not desired[1:].any()


@settings(max_examples=50)
@given(seed=st.integers(0, 2**32 - 1), joints=st.integers(1, 7))
def test_a_stop_at_a_position_ends_there_within_the_limits(seed: int, joints: int) -> None:
    random = np.random.default_rng(seed)
    velocity, acceleration = random.uniform(0.5, 2.0, joints), random.uniform(0.5, 20.0, joints)
    jerk = random.uniform(5.0, 500.0, joints)
    limits = motion_limits(
        {
            "joints": [f"joint{j}" for j in range(joints)],
            "limits.velocity": velocity.tolist(),
            "limits.acceleration": acceleration.tolist(),
            "limits.jerk": jerk.tolist(),
        }
    )
    present = random.uniform(-1.0, 1.0, (3, joints)) * [0.0 * velocity + 1.0, 0.5 * velocity, 0.0 * velocity]
    position = present[0] + random.uniform(-0.05, 0.05, joints)
    motion = stop_at(position, present, limits)
    path = states(motion, np.linspace(0.0, motion.end, 400))
    np.testing.assert_allclose(path[0], present, atol=1e-9)
    np.testing.assert_allclose(path[-1, 0], position, atol=1e-9)
    assert not path[-1, 1:].any()
    assert (np.abs(path[:, 1]) <= limits.planned_velocity + 1e-9).all()
    assert (np.abs(path[:, 2]) <= acceleration + 1e-9).all()


def test_a_stop_where_it_rests_takes_no_time(limits: MotionLimits) -> None:
    present = np.zeros((3, len(limits.joints)))
    present[0] = 0.3
    motion = stop_at(present[0], present, limits)
    assert motion.end < 1e-6
    np.testing.assert_array_equal(states(motion, np.array([0.0, 1.0]))[:, 0], np.full((2, len(limits.joints)), 0.3))
