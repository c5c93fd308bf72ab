"""Limits of motions: what is set, what the description contains, and what follows from both."""

import math

import numpy as np
import pytest
from support.testarms import CRANE, PANDA, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_core.trajectories.limits import PARAMETERS, MotionLimits, limits_schema, motion_limits, with_arm


def test_they_are_those_of_the_description(arm: Arm, limits: MotionLimits) -> None:
    robot = arm.robot
    assert limits.joints == robot.joints
    np.testing.assert_array_equal(limits.effort, robot.effort_limit)
    np.testing.assert_array_equal(limits.velocity, robot.velocity_limit or [math.inf] * arm.joints)
    described = np.array(robot.position_limits or [(-math.inf, math.inf)] * arm.joints).T
    np.testing.assert_array_equal([limits.lower, limits.upper], described)
    assert np.isinf(limits.given_acceleration).all()


def test_what_is_set_replaces_what_is_described(arm: Arm) -> None:
    fields = ("lower", "upper", "velocity", "acceleration", "jerk", "effort")
    names = ("min_position", "max_position", "velocity", "acceleration", "jerk", "effort")
    values: list[Array] = [np.full(arm.joints, value) for value in (-0.5, 0.25, 0.125, 7.0, 300.0, 3.0)]
    settings = {f"limits.{name}": value.tolist() for name, value in zip(names, values, strict=True)}
    limits = motion_limits({**arm.settings, **settings})
    for field, value in zip(fields, values, strict=True):
        np.testing.assert_array_equal(getattr(limits, field), value)
    np.testing.assert_array_equal(limits.given_acceleration, limits.acceleration)


def test_an_arm_completes_what_a_node_does_not_know() -> None:
    """In the order of the node's joints; what the node has set stays. A payload costs effort."""
    arm = ArmDefinition("scara", effort={"joint3": 99.0}, payload=1.0)
    order = ["joint3", "joint1", "joint2", "joint4"]
    known = {p.name: p.default for p in PARAMETERS} | {"joints": order, "limits.velocity": 0.5, "robot.xacro": None}
    limits = motion_limits({name: value for name, value in with_arm(known, arm).items() if value not in (None, "")})
    described = dict(zip(arm.robot().joints, arm.robot().effort_limit, strict=True))
    assert limits.joints == tuple(order)
    assert limits.effort.tolist() == [99.0, *(described[joint] for joint in order[1:])]
    assert limits.velocity.tolist() == [0.5] * 4
    empty = motion_limits({"robot.description": "scara", "joints": order})
    assert (limits.acceleration < empty.acceleration).any()
    set_limits = with_arm({**known, "limits.effort": [1.0, 2.0, 3.0, 4.0]}, arm)
    assert set_limits["limits.effort"] == [1.0, 2.0, 3.0, 4.0]


def test_other_joints_keep_their_defaults() -> None:
    default = motion_limits(PANDA.settings)
    limits = motion_limits({**PANDA.settings, "limits.acceleration": [0.0, 99.0, *[0.0] * 5]})
    expected = default.acceleration.copy()
    expected[1] = 99.0
    np.testing.assert_array_equal(limits.acceleration, expected)


def test_the_default_acceleration_needs_half_the_torque_beyond_gravity_and_a_fifth_of_a_second(
    arm: Arm, limits: MotionLimits
) -> None:
    assert (limits.acceleration > 0.0).all()
    assert (limits.acceleration <= 5.0 * limits.velocity * (1.0 + 1e-12)).all()
    np.testing.assert_allclose(limits.jerk, 10.0 * limits.acceleration)
    random = np.random.default_rng(5)
    low, high = np.maximum(limits.lower, -math.pi), np.minimum(limits.upper, math.pi)
    for q in low + random.random((50, arm.joints)) * (high - low):
        gravity = np.abs(arm.effort(q))
        for j, unit in enumerate(np.eye(arm.joints)):
            needed = abs(arm.effort(q, ddq=unit * limits.acceleration)[j] - arm.effort(q)[j])
            assert needed <= max(0.55 * (limits.effort[j] - gravity[j]), 0.051 * limits.effort[j])


def test_joints_are_matched_by_name() -> None:
    order = [2, 0, 1]
    limits = motion_limits(CRANE.settings)
    other = motion_limits({**CRANE.settings, "joints": [CRANE.names[i] for i in order]})
    for field in ("lower", "upper", "velocity", "acceleration", "jerk", "effort"):
        np.testing.assert_allclose(getattr(other, field), getattr(limits, field)[order], rtol=0.2)
    assert other.units == tuple(limits.units[i] for i in order)
    swapped = motion_limits({"robot.description": "two_link", "joints": ["joint2", "joint1"]})
    np.testing.assert_array_equal(swapped.effort, [50.0, 100.0])
    renamed = motion_limits({"robot.description": "two_link", "joints": ["shoulder", "elbow"]})
    np.testing.assert_array_equal(renamed.effort, [100.0, 50.0])


def test_without_an_arm_only_acceleration_and_jerk_have_defaults(unlimited: MotionLimits) -> None:
    assert np.isinf([unlimited.velocity, unlimited.effort, unlimited.upper, -unlimited.lower]).all()
    assert unlimited.acceleration.tolist() == [5.0, 5.0]
    assert unlimited.model is None


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"joints": ["a"], "robot.description": "no_arm"}, "no_arm"),
        ({"joints": ["a", "b"], "robot.description": "panda"}, "a"),
        ({"joints": ["a", "b", "c"], "robot.description": "two_link"}, "two_link has 2 joints, and joints names 3"),
        ({}, "neither joints nor robot.description"),
        ({"joints": ["a"], "limits.min_position": 1.0}, r"limits.min_position: \[1.0\] exceeds limits.max_position"),
        ({"joints": ["a"], "limits.velocity": -1.0}, "limits.velocity.*>= 0"),
    ],
)
def test_what_cannot_be_used_is_refused(settings: dict[str, object], reason: str) -> None:
    with pytest.raises(ParameterError, match=reason):
        motion_limits(settings)


def test_the_schema_refuses_an_arm_that_cannot_be_used() -> None:
    with pytest.raises(ParameterError, match="panda_joint1"):
        limits_schema({"joints": ["a"], "robot.description": "panda"})
