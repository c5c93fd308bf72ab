"""Serialized trajectories are read as rclpy reads them, or left to it."""

import math
import struct
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from rclpy.serialization import serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pidtsm_controller.trajectory_points import read_points
from pidtsm_ros.stamps import nanoseconds
from pidtsm_ros.trajectory_cdr import read_serialized

FIELDS = ("positions", "velocities", "accelerations", "effort")


def made(joints: int, fields: int, points: int, effort: bool = False) -> JointTrajectory:
    """Random numbers; names of all lengths, as they shift what follows."""
    random = np.random.default_rng(joints)
    message = JointTrajectory(joint_names=["j" * (k + 1) for k in range(joints)])
    message.header.frame_id = "x" * joints
    message.header.stamp.sec, message.header.stamp.nanosec = 7, 123456789
    for k in range(points):
        point = JointTrajectoryPoint(time_from_start=Duration(sec=k, nanosec=int(random.integers(10**9))))
        for name in (*FIELDS[:fields], *(["effort"] if effort else [])):
            setattr(point, name, random.normal(size=joints).tolist())
        message.points.append(point)
    return message


@pytest.mark.parametrize("effort", [False, True])
@pytest.mark.parametrize("fields", [1, 2, 3])
@pytest.mark.parametrize("joints", [1, 2, 3, 4, 6, 7])
def test_points_are_read_as_rclpy_reads_them(joints: int, fields: int, effort: bool) -> None:
    message = made(joints, fields, 20, effort)
    read = read_serialized(serialize_message(message))
    assert read is not None
    times, states = read_points(message)
    assert (read.stamp, list(read.names)) == (nanoseconds(message.header.stamp), message.joint_names)
    np.testing.assert_array_equal(read.times, times)
    np.testing.assert_array_equal(read.states, states)


def broken(change: str) -> Any:
    message = made(3, 2, 5)
    point = message.points[3]
    if change == "not finite":
        point.positions[1] = math.nan
    elif change == "too few":
        point.velocities.pop()
    elif change == "too many":
        point.velocities.append(0.0)
    elif change == "a field is missing":
        point.velocities = []
    elif change == "no positions":
        for each in message.points:
            each.positions = []
    elif change == "no points":
        message.points = []
    else:
        message.joint_names = []
    return message


@pytest.mark.parametrize(
    "change",
    ["not finite", "too few", "too many", "a field is missing", "no positions", "no points", "no joints"],
)
def test_a_message_with_a_mistake_is_left_to_rclpy(change: str) -> None:
    assert read_serialized(serialize_message(broken(change))) is None


def test_a_message_that_is_cut_off_is_left_to_rclpy() -> None:
    message = made(3, 2, 5)
    data = serialize_message(message)
    last = message.points[-1].time_from_start
    end = data.index(struct.pack("<iI", last.sec, last.nanosec)) + 8  # Behind it, rclpy leaves bytes of other messages.
    assert read_serialized(data[:end]) is not None
    assert all(read_serialized(data[:length]) is None for length in range(end))
