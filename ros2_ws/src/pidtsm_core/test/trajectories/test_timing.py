"""Fast motions through way points."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.testarms import CRANE, PANDA, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.trajectories.checking import check
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.interpolation import interpolate
from pidtsm_core.trajectories.limits import MotionLimits, motion_limits
from pidtsm_core.trajectories.motion import PiecewiseMotion
from pidtsm_core.trajectories.timing import retime


def sampled(motion: PiecewiseMotion) -> tuple[Array, Array]:
    """Times, and states, shape (times, 3, joints), until 0.1 s after the end."""
    times = np.arange(0.0, motion.end + 0.1, 5e-4)
    states = np.empty((times.size, 3, motion.parameters.shape[0]))
    for t, state in zip(times, states, strict=True):
        motion.evaluate(float(t), state)
    return times, states


def waypoints(limits: MotionLimits, count: int, seed: int = 0) -> Array:
    """Random positions in the inner part of the range."""
    low, high = np.maximum(limits.lower, -1.5), np.minimum(limits.upper, 1.5)
    random = np.random.default_rng(seed).random((count, low.size))
    return np.asarray(low + (0.35 + 0.3 * random) * (high - low))


@pytest.mark.parametrize("count", [1, 2, 3, 12, 80])
def test_it_passes_through_all_points_within_all_limits_and_rests_at_both_ends(
    limits: MotionLimits, count: int
) -> None:
    points = waypoints(limits, min(count, 12))
    if count > 12:
        angle = np.linspace(0.0, 6.0, count)[:, None]
        points = points.mean(axis=0) + 0.1 * np.sin(angle + np.arange(points.shape[1]))
    motion = retime(points, limits)
    times, states = sampled(motion)
    np.testing.assert_allclose(states[0], [points[0], *np.zeros((2, points.shape[1]))], atol=1e-9)
    np.testing.assert_allclose(states[-1], [points[-1], *np.zeros((2, points.shape[1]))], atol=1e-9)
    for velocity, bound in ((states[:, 1], limits.planned_velocity), (states[:, 2], limits.acceleration)):
        assert (np.abs(velocity) <= bound * (1.0 + 1e-9) + 1e-9).all()
    assert (np.abs(np.diff(states[:, 2], axis=0)) <= limits.jerk * (times[1] - times[0]) * (1.0 + 1e-6) + 1e-9).all()
    check(motion, limits)
    place = 0
    for point in points:
        distances = np.abs(states[place:, 0] - point).max(axis=1)
        place += int(np.argmax(distances < 2e-3))
        assert distances.min() < 2e-3


@settings(max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1),
    joints=st.integers(1, 7),
    count=st.integers(2, 20),
    size=st.sampled_from([1e-5, 0.03, 1.0]),
)
def test_any_way_points_and_limits_are_kept(seed: int, joints: int, count: int, size: float) -> None:
    random = np.random.default_rng(seed)
    acceleration = random.uniform(0.5, 30.0, joints)
    limits = motion_limits(
        {
            "joints": [f"joint{j}" for j in range(joints)],
            "limits.velocity": random.uniform(0.3, 5.0, joints).tolist(),
            "limits.acceleration": acceleration.tolist(),
            "limits.jerk": (random.uniform(3.0, 100.0, joints) * acceleration).tolist(),
        }
    )
    points = np.cumsum(size * random.normal(size=(count, joints)), axis=0)
    motion = retime(points, limits)
    states = np.empty((2000, 3, joints))
    times = np.linspace(0.0, motion.end, len(states))
    for t, state in zip(times, states, strict=True):
        motion.evaluate(float(t), state)
    assert (np.abs(states[:, 1]) <= limits.planned_velocity * (1.0 + 1e-9) + 1e-9).all()
    assert (np.abs(states[:, 2]) <= acceleration * (1.0 + 1e-9) + 1e-9).all()
    steps = np.abs(np.diff(states[:, 2], axis=0))
    assert (steps <= limits.jerk * times[1] * (1.0 + 1e-6) + 1e-9).all()
    np.testing.assert_allclose(states[-1], [points[-1], *np.zeros((2, joints))], atol=1e-9)


@pytest.mark.parametrize("arm", [CRANE, PANDA], ids=str)
def test_two_points_are_joined_by_a_straight_line_on_which_a_limit_is_always_reached(arm: Arm) -> None:
    limits = motion_limits({**arm.settings, "limits.effort": 1e4})
    start, end = waypoints(limits, 2)
    motion = retime(np.array([start, end]), limits)
    times, states = sampled(motion)
    share = (states[:, 0] - start) / (end - start)
    np.testing.assert_allclose(share, share[:, :1] + np.zeros(arm.joints), atol=1e-9)
    jerk = np.diff(states[:, 2], axis=0) / np.diff(times)[:, None]
    reached = np.maximum(
        np.abs(states[:-1, 1:] / np.array([limits.planned_velocity, limits.acceleration])).max(axis=(1, 2)),
        np.abs(jerk / limits.jerk).max(axis=1),
    )
    moving = times[:-1] < motion.end
    assert np.mean(reached[moving] > 0.999) > 0.95


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-6, 2e-9, 0.0])
def test_any_two_postures_are_joined_however_near(arm: Arm, size: float) -> None:
    """Round numbers, joints that stay, and ends that differ by rounding alone."""
    limits, random = motion_limits(arm.settings), np.random.default_rng(1)
    for _ in range(50):
        start, end = waypoints(limits, 2, int(random.integers(1000)))
        way = size * (end - start) * random.integers(0, 2, end.size) + 1e-16 * random.integers(-1, 2, end.size)
        start = np.round(start, 2)
        motion = retime(np.array([start, start + way]), limits)
        assert 0.0 < motion.end < 10.0
        np.testing.assert_allclose(sampled(motion)[1][-1, 0], start + way, atol=1.1e-9)


@pytest.mark.parametrize("count", [2, 3])
def test_as_a_message_with_times_of_whole_nanoseconds_it_keeps_the_limits(arm: Arm, count: int) -> None:
    limits = motion_limits({**arm.settings, "limits.effort": 1e4})
    for seed in range(40):
        motion = retime(waypoints(limits, count, seed), limits)
        states = np.zeros((motion.times.size, 3, arm.joints))
        for time, state in zip(motion.times, states, strict=True):
            motion.evaluate(max(float(time) - 1e-12, 0.0), state)
        states[-1, 1:] = 0.0
        check(interpolate(np.round(motion.times, 9), states[1:], states[0]), limits)


def test_it_is_slowed_down_until_the_efforts_suffice() -> None:
    start = np.array(PANDA.start)
    gravity = max(np.abs(PANDA.effort(start)).max(), np.abs(PANDA.effort(start + 0.3)).max())
    weak = motion_limits({**PANDA.settings, "limits.effort": 1.1 * gravity})
    strong = motion_limits({**PANDA.settings, "limits.acceleration": weak.acceleration.max() * 10})
    weak = motion_limits(
        {**PANDA.settings, "limits.acceleration": strong.acceleration.tolist(), "limits.effort": 1.1 * gravity}
    )
    points = np.array([start, start + 0.3])
    slow, fast = retime(points, weak), retime(points, strong)
    check(slow, weak)
    assert slow.end > fast.end


@pytest.mark.parametrize(
    ("points", "settings", "reason"),
    [
        ([[0.0], [np.nan]], {}, "not finite"),
        ([[0.0], [3.0]], {"limits.min_position": -1.0, "limits.max_position": 1.0}, "a: the position would be 3 rad"),
        ([[0.0], [0.9], [0.95], [0.0]], {"limits.min_position": -1.0, "limits.max_position": 0.951}, "a: the position"),
    ],
)
def test_what_is_impossible_is_refused(points: list[list[float]], settings: dict[str, float], reason: str) -> None:
    with pytest.raises(TrajectoryError, match=reason):
        retime(np.array(points), motion_limits({"joints": ["a"], **settings}))


def test_an_arm_too_weak_for_gravity_is_not_moved() -> None:
    limits = motion_limits({**PANDA.settings, "limits.effort": 5.0})
    with pytest.raises(TrajectoryError, match="the torque would be"):
        retime(np.array([PANDA.start, np.array(PANDA.start) + 0.2]), limits)
