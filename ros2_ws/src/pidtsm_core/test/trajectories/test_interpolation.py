"""Motions through points."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.arrays import Array
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.interpolation import Interpolation, interpolate, plan
from pidtsm_core.trajectories.motion import PiecewiseMotion

TIMES = np.array([1.0, 2.0, 4.0])
POINTS = np.array(
    [
        [[0.1, 0.2], [0.1, 0.0], [0.0, 0.3]],
        [[0.5, 0.0], [0.2, -0.1], [0.1, 0.0]],
        [[0.7, -0.4], [0.0, 0.0], [0.0, 0.0]],
    ]
)
PRESENT = np.array([[0.05, 0.15], [0.2, -0.3], [0.4, 0.1]])
REST = np.zeros((3, 2))
KINDS: list[tuple[int, Interpolation]] = [(1, "linear"), (1, "spline"), (2, "spline"), (3, "spline")]


def at(motion: PiecewiseMotion, t: float) -> Array:
    desired = np.full((3, motion.parameters.shape[0]), np.nan)
    motion.evaluate(t, desired)
    return desired


def plan_of(fields: int, elapsed: float = 0.0, interpolation: Interpolation = "spline") -> PiecewiseMotion:
    return plan(TIMES, POINTS[:, :fields], elapsed, PRESENT, 0.2, interpolation)


@pytest.mark.parametrize(("fields", "interpolation"), KINDS)
@pytest.mark.parametrize("elapsed", [0.0, 0.3, 1.0, 1.2])
def test_it_leaves_the_present_motion_smoothly_meets_the_points_and_holds(
    fields: int, interpolation: Interpolation, elapsed: float
) -> None:
    motion = plan_of(fields, elapsed, interpolation)
    continuous = 3 if fields == 3 or (fields, interpolation) == (1, "spline") else 2
    np.testing.assert_allclose(at(motion, elapsed)[:continuous], PRESENT[:continuous], atol=1e-13)
    for t, point in zip(TIMES, POINTS, strict=True):
        if t > elapsed:
            for side in (t - 1e-12, t):
                np.testing.assert_allclose(at(motion, side)[0], point[0], atol=1e-10)
            np.testing.assert_allclose(at(motion, t - 1e-12)[1:fields], point[1:fields], atol=1e-9)
    for t in (4.0, 50.0):
        np.testing.assert_allclose(at(motion, t), [POINTS[-1, 0], [0.0, 0.0], [0.0, 0.0]], atol=1e-13)


@pytest.mark.parametrize(("fields", "interpolation"), KINDS)
def test_derivatives_are_exact(fields: int, interpolation: Interpolation) -> None:
    motion, step = plan_of(fields, 0.0, interpolation), 1e-5
    for t in (0.3, 1.5, 3.1):
        before, now, after = (at(motion, t + d) for d in (-step, 0.0, step))
        np.testing.assert_allclose((after[:2] - before[:2]) / (2 * step), now[1:], atol=1e-8)


def test_positions_alone_can_be_joined_by_lines_after_the_first_segment() -> None:
    motion = plan_of(1, 0.0, "linear")
    np.testing.assert_allclose(at(motion, 1.25), [[0.2, 0.15], [0.4, -0.2], [0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(at(motion, 1.0 - 1e-12)[1], [0.4, -0.2], atol=1e-9)


@settings(max_examples=50)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 30),
    joints=st.integers(1, 7),
    pace=st.floats(0.005, 5.0),
)
def test_a_spline_has_a_continuous_acceleration_and_ends_at_rest(
    seed: int, count: int, joints: int, pace: float
) -> None:
    random = np.random.default_rng(seed)
    times = 7.0 + np.concatenate([[0.0], np.cumsum(pace * random.uniform(0.2, 1.0, count))])
    points, start = random.uniform(-3.0, 3.0, (count, 1, joints)), random.uniform(-1.0, 1.0, (3, joints))
    motion = interpolate(times, points, start)
    largest = np.abs([at(motion, t) for t in np.linspace(times[0], times[-1], 200)]).max(axis=(0, 2))
    np.testing.assert_allclose(at(motion, times[0]), start, atol=1e-12 * largest.max())
    for t, point in zip(times[1:], points[:, 0], strict=True):
        before, after = at(motion, np.nextafter(t, 0.0)), at(motion, t)
        np.testing.assert_allclose(after[0], point, atol=1e-12 * largest[0])
        for value, other, scale in zip(before, after, largest, strict=True):
            np.testing.assert_allclose(value, other, atol=1e-9 * scale)


def test_with_velocities_the_segments_are_cubics() -> None:
    motion = plan_of(2)
    # The acceleration of a cubic is linear.
    for first, last in ((0.0, 1.0), (1.0, 2.0), (2.0, 4.0)):
        a, b, c = (at(motion, first + share * (last - first))[2] for share in (0.25, 0.5, 0.75))
        np.testing.assert_allclose(b, (a + c) / 2.0, atol=1e-12)


@pytest.mark.parametrize(
    ("times", "points", "elapsed", "reason"),
    [
        ([0.0, 1.0, 1.0], POINTS, 0.0, "increase"),
        ([2.0, 1.0, 3.0], POINTS, 0.0, "increase"),
        ([-1.0, 1.0, 3.0], POINTS, 0.0, "0 or later"),
        ([1.0, 2.0, np.nan], POINTS, 0.0, "not finite"),
        ([1.0, 2.0], [[[np.inf, 0.0]], [[1.0, 1.0]]], 0.0, "not finite"),
        ([1.0, 2.0, 4.0], POINTS, 4.0, "it is over: it started 4 s ago and takes 4 s"),
        ([0.0], POINTS[-1:], 0.0, "takes no time"),
        ([1.0, 2.0], POINTS[:2], 0.0, "must end at rest"),
        ([0.0, 1.0], [[[0.06, 0.3]], [[1.0, 1.0]]], 0.0, "point 1 is due now, and 0.3 from the present"),
        ([0.0, 1.0, 2.0], [[[0.0, 0.0]], [[0.3, 0.0]], [[1.0, 1.0]]], 1.5, "point 2 is due now, and 0.3 from"),
    ],
)
def test_trajectories_that_cannot_be_followed_are_refused(
    times: list[float], points: object, elapsed: float, reason: str
) -> None:
    with pytest.raises(TrajectoryError, match=reason):
        plan(np.array(times), np.array(points), elapsed, REST, 0.2)
