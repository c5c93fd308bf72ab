"""Motions that replace another one while it is under way."""

import math

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import resolve
from pidtsm_core.references import ReferenceMotion, reference_schema
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.interpolation import plan
from pidtsm_core.trajectories.limits import MotionLimits, motion_limits
from pidtsm_core.trajectories.splice import MotionUnderWay, unwind
from pidtsm_core.trajectories.stopping import stop

TIMES = np.array([1.0, 2.0, 4.0])
POINTS = np.array(
    [
        [[0.1, 0.2], [0.1, 0.0], [0.0, 0.3]],
        [[0.5, 0.0], [0.2, -0.1], [0.1, 0.0]],
        [[0.7, -0.4], [0.0, 0.0], [0.0, 0.0]],
    ]
)
NOW = 10**9


@pytest.fixture
def under_way(unlimited: MotionLimits) -> MotionUnderWay:
    """A sine of 0.3 rad and 0.2 Hz that begins at 0."""
    motion = ReferenceMotion(resolve(reference_schema, {"reference.name": "sines"}, 2))
    return MotionUnderWay(motion, 0, unlimited)


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


def test_a_motion_planned_ahead_takes_over_without_a_step(under_way: MotionUnderWay, unlimited: MotionLimits) -> None:
    desired(under_way, NOW)
    begin, start = NOW + 20_000_000, NOW // 2
    present = under_way.state_at(begin)
    motion = plan(TIMES, POINTS, (begin - start) * 1e-9, present, 1.0)
    under_way.replace(motion, start, begin)
    np.testing.assert_array_equal(desired(under_way, begin - 1), under_way.state_at(begin - 1))
    np.testing.assert_allclose(desired(under_way, begin), present, atol=1e-12)
    np.testing.assert_allclose(desired(under_way, start + 2 * NOW), POINTS[1], atol=1e-12)
    expected = desired(under_way, start + 3 * NOW)
    with pytest.raises(TrajectoryError, match=r"2\.48 s too late"):
        under_way.replace(stop(present, unlimited), begin, begin)
    np.testing.assert_array_equal(desired(under_way, start + 3 * NOW), expected)


@pytest.mark.parametrize(
    ("count", "factor", "reason"), [(2, 1.0, "must end at rest"), (3, 100.0, "joint1: the velocity would be")]
)
def test_a_refused_trajectory_changes_nothing(count: int, factor: float, reason: str) -> None:
    motion = ReferenceMotion(resolve(reference_schema, {"reference.name": "sines"}, 2))
    limits = motion_limits({"joints": ("joint1", "joint2"), "limits.velocity": 3.0})
    under_way = MotionUnderWay(motion, 0, limits)
    under_way.follow(NOW, NOW, TIMES, POINTS, 0.2)
    expected = desired(under_way, 3 * NOW)
    with pytest.raises(TrajectoryError, match=reason):
        under_way.follow(3 * NOW, 3 * NOW, TIMES[:count], factor * POINTS[:count], 0.2)
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


def test_a_clock_that_is_set_changes_no_motion(under_way: MotionUnderWay) -> None:
    under_way.follow(NOW, 2 * NOW, TIMES, POINTS, 0.2)
    expected = [under_way.state_at(NOW), POINTS[1]]
    under_way.move(-5 * NOW)
    np.testing.assert_array_equal(desired(under_way, -4 * NOW), expected[0])
    np.testing.assert_allclose(desired(under_way, -NOW), expected[1], atol=1e-12)


def test_joints_that_turn_without_end_go_to_the_nearest_turn() -> None:
    urdf = (
        '<robot name="wheel"><link name="base"/><link name="rim"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="hub" '
        'type="continuous"><parent link="base"/><child link="rim"/><axis xyz="0 0 1"/>'
        '<limit effort="9" velocity="9"/></joint></robot>'
    )
    turn = 2.0 * math.pi
    for limits, expected in (
        (motion_limits({"robot.description": urdf}), [[[-0.1 + 2 * turn]], [[3.0 + 2 * turn]]]),
        (motion_limits({"joints": ["hub"]}), [[[-0.1]], [[3.0]]]),
    ):
        unwound = unwind(np.array([[[-0.1]], [[3.0]]]), np.array([2 * turn + 0.3]), limits)
        np.testing.assert_allclose(unwound, expected)
