"""Trajectories that are commanded while another motion is in progress."""

import numpy as np
import pytest

from pidtsm_core.parameters import Array, resolve
from pidtsm_core.references import ReferenceMotion, reference_schema
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.interpolation import plan
from pidtsm_core.trajectories.limits import unlimited
from pidtsm_core.trajectories.motion import PiecewiseMotion
from pidtsm_core.trajectories.splice import MotionUnderWay

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
NOW = 10**9


def at(motion: PiecewiseMotion, t: float) -> Array:
    desired = np.full((3, 2), np.nan)
    motion.evaluate(t, desired)
    return desired


def plan_of(fields: int, elapsed: float = 0.0, present: Array = PRESENT) -> PiecewiseMotion:
    return plan(TIMES, POINTS[:, :fields], elapsed, present, 0.2, "linear")


@pytest.mark.parametrize("fields", [1, 2, 3])
@pytest.mark.parametrize("elapsed", [0.0, 0.3, 1.0, 1.2])
def test_it_leaves_the_present_motion_smoothly_meets_the_points_and_holds(fields: int, elapsed: float) -> None:
    motion = plan_of(fields, elapsed)
    continuous = 3 if fields == 3 else 2
    np.testing.assert_allclose(at(motion, elapsed)[:continuous], PRESENT[:continuous], atol=1e-13)
    for t, point in zip(TIMES, POINTS, strict=True):
        if t > elapsed:
            for side in (t - 1e-12, t):
                np.testing.assert_allclose(at(motion, side)[0], point[0], atol=1e-10)
            np.testing.assert_allclose(at(motion, t - 1e-12)[1:fields], point[1:fields], atol=1e-9)
    for t in (4.0, 50.0):
        np.testing.assert_allclose(at(motion, t), [POINTS[-1, 0], [0.0, 0.0], [0.0, 0.0]], atol=1e-13)


@pytest.mark.parametrize("fields", [1, 2, 3])
def test_derivatives_are_exact(fields: int) -> None:
    motion, step = plan_of(fields), 1e-5
    for t in (0.3, 1.5, 3.1):
        before, now, after = (at(motion, t + d) for d in (-step, 0.0, step))
        np.testing.assert_allclose((after[:2] - before[:2]) / (2 * step), now[1:], atol=1e-8)


def test_positions_alone_are_joined_by_lines_after_the_first_segment() -> None:
    motion = plan_of(1)
    np.testing.assert_allclose(at(motion, 1.25), [[0.2, 0.15], [0.4, -0.2], [0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(at(motion, 1.0 - 1e-12)[1], [0.4, -0.2], atol=1e-9)


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


@pytest.fixture
def under_way() -> MotionUnderWay:
    """A sine of 0.3 rad and 0.2 Hz that begins at 0."""
    motion = ReferenceMotion(resolve(reference_schema, {"reference.name": "sines"}, 2))
    return MotionUnderWay(motion, 0, unlimited(2))


def desired(motion: MotionUnderWay, now: int) -> Array:
    result = np.full((3, 2), np.nan)
    motion.evaluate(now, result)
    return result


def test_a_trajectory_for_later_begins_with_the_motion_at_its_start(under_way: MotionUnderWay) -> None:
    start = 2 * NOW
    expected = desired(under_way, start)
    before = desired(under_way, start - 1)
    under_way.follow(NOW, start, TIMES, POINTS, 0.2)
    np.testing.assert_array_equal(desired(under_way, start - 1), before)
    np.testing.assert_allclose(desired(under_way, start), expected, atol=1e-13)
    np.testing.assert_allclose(desired(under_way, start + 2 * NOW), POINTS[1], atol=1e-12)


def test_the_last_trajectory_counts(under_way: MotionUnderWay) -> None:
    under_way.follow(NOW, 2 * NOW, TIMES, POINTS, 0.2)
    under_way.follow(NOW, NOW, TIMES, POINTS, 0.2)
    np.testing.assert_allclose(desired(under_way, 3 * NOW), POINTS[1], atol=1e-12)
    present = desired(under_way, 3 * NOW + 500)
    under_way.follow(3 * NOW + 500, 3 * NOW + 500, TIMES, -POINTS, 0.2)
    np.testing.assert_allclose(desired(under_way, 3 * NOW + 500), present, atol=1e-13)
    np.testing.assert_allclose(desired(under_way, 9 * NOW)[0], -POINTS[-1, 0], atol=1e-13)


def test_a_refused_trajectory_changes_nothing(under_way: MotionUnderWay) -> None:
    under_way.follow(NOW, NOW, TIMES, POINTS, 0.2)
    expected = desired(under_way, 3 * NOW)
    with pytest.raises(TrajectoryError):
        under_way.follow(3 * NOW, 3 * NOW, TIMES[:2], POINTS[:2], 0.2)
    np.testing.assert_array_equal(desired(under_way, 3 * NOW), expected)


def test_a_cancelled_trajectory_comes_to_rest_smoothly_and_holds(under_way: MotionUnderWay) -> None:
    present = desired(under_way, NOW)
    under_way.follow(NOW, 2 * NOW, TIMES, POINTS, 0.2)
    under_way.cancel(NOW)
    np.testing.assert_allclose(desired(under_way, NOW), present, atol=1e-14)
    path = np.array([desired(under_way, NOW + round(0.5e9 * share)) for share in np.linspace(0.0, 1.0, 50)])
    assert (np.diff(path[:, 0], axis=0) > -1e-15).all(), "it does not turn back"
    assert (path[:, 1] < 1.1 * present[1]).all(), "it does not hurry"
    assert not path[-1, 1:].any()
    np.testing.assert_array_equal(desired(under_way, 9 * NOW), path[-1])
