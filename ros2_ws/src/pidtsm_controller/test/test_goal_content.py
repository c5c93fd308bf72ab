"""Goals are taken as bytes and read as rclpy reads them."""

import math
import struct
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
from rclpy.serialization import deserialize_message, serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint, MultiDOFJointTrajectoryPoint

from pidtsm_controller.goal_content import GoalContent, read_goal
from pidtsm_controller.trajectory_points import MOST, efforts_of, read_points, states_of
from pidtsm_core.parameters.joints import MessageError
from pidtsm_ros.serialized_goals import serialized_request

Request = FollowJointTrajectory.Impl.SendGoalService.Request
FIELDS = ("positions", "velocities", "accelerations", "effort")


def request(joints: int, fields: int, points: int) -> Any:
    """Random numbers; names of all lengths and several tolerances, as they shift what follows."""
    random = np.random.default_rng(joints)
    made = Request()
    made.goal_id.uuid = random.integers(0, 256, 16).astype(np.uint8)
    trajectory = made.goal.trajectory
    trajectory.joint_names = ["j" * (k + 1) for k in range(joints)]
    trajectory.header.frame_id = "x" * joints
    trajectory.header.stamp.sec = 7
    for k in range(points):
        point = JointTrajectoryPoint(time_from_start=Duration(sec=k, nanosec=int(random.integers(10**9))))
        for name in FIELDS[:fields]:
            setattr(point, name, random.normal(size=joints).tolist())
        trajectory.points.append(point)
    made.goal.path_tolerance = [JointTolerance(name="j" * k, position=float(k)) for k in range(1, joints + 1)]
    made.goal.multi_dof_trajectory.points = [MultiDOFJointTrajectoryPoint()] * (joints % 2)
    made.goal.goal_time_tolerance = Duration(sec=-1, nanosec=5)
    return made


def taken(made: Any) -> Any:
    """The request as the action server takes it."""
    kind = serialized_request(FollowJointTrajectory)
    assert kind is not None, "this rclpy works so"
    return deserialize_message(serialize_message(made), kind)


@pytest.mark.parametrize("points", [0, 1, 2, 1000])
@pytest.mark.parametrize("fields", [1, 2, 3, 4])
@pytest.mark.parametrize("joints", [1, 2, 3, 7])
def test_a_goal_is_read_as_rclpy_reads_it(joints: int, fields: int, points: int) -> None:
    made = request(joints, fields, points)
    found = taken(made)
    assert found.goal_id == made.goal_id
    assert deserialize_message(found.goal, FollowJointTrajectory.Goal) == made.goal
    goal = read_goal(found.goal)
    trajectory = made.goal.trajectory
    assert (goal.stamp, list(goal.names), goal.count) == (7 * 10**9, trajectory.joint_names, points)
    if points:
        assert goal.points is not None
        for ours, theirs in zip(states_of(goal.names, goal.points), read_points(trajectory), strict=True):
            np.testing.assert_array_equal(ours, theirs)
        efforts = efforts_of(goal.names, goal.points)
        assert (efforts is None) == (fields < 4)
        if efforts is not None:
            np.testing.assert_array_equal(efforts, [point.effort for point in trajectory.points])
    made.goal.trajectory = JointTrajectory()
    goal.rest.trajectory = JointTrajectory()
    assert goal.rest == made.goal


def test_lengths_and_times_are_read_whatever_they_are() -> None:
    made = request(3, 2, 4)
    points = made.goal.trajectory.points
    points[1].velocities = [1.0] * 5
    points[2].positions = []
    points[3].time_from_start.sec = -3
    points[3].effort = [math.nan] * 3
    goal = read_goal(taken(made).goal)
    assert goal.points is not None
    assert goal.points.lengths.tolist() == [[3, 3, 0, 0], [3, 5, 0, 0], [0, 3, 0, 0], [3, 3, 0, 3]]
    assert goal.points.clock[3, 0] == -3
    assert np.isnan(goal.points.values[3, 3]).all()
    assert goal.rest.path_tolerance == made.goal.path_tolerance


def test_points_and_tolerances_that_are_too_many_are_not_read() -> None:
    made = request(2, 1, 0)
    made.goal.trajectory.points = [JointTrajectoryPoint(positions=[0.0, 0.0])] * (MOST + 1)
    goal = read_goal(taken(made).goal)
    assert (goal.count, goal.points, goal.rest) == (MOST + 1, None, None)
    made = request(2, 1, 1)
    made.goal.path_tolerance = [JointTolerance(name="j")] * 10_000
    goal = read_goal(taken(made).goal)
    assert goal.points is not None
    assert goal.rest is None


def test_what_is_no_goal_is_rejected() -> None:
    data = taken(request(2, 2, 3)).goal
    end = data.index(struct.pack("<I", 3), 24) + 4
    for length in range(end):
        with pytest.raises(MessageError):
            read_goal(data[:length])
    for length in range(end, len(data)):
        read(data[:length])


def read(data: bytes) -> GoalContent | None:
    """The goal, None if it is rejected."""
    try:
        return read_goal(data)
    except MessageError:
        return None
