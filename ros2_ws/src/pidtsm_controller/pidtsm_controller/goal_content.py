"""The content of a goal of FollowJointTrajectory, and which goals are rejected."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from control_msgs.action import FollowJointTrajectory

from pidtsm_controller.trajectory_points import MOST, times_of
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.timing import NANOSECONDS, seconds
from pidtsm_ros.cdr import STAMP_BEGIN, serialized_nanoseconds
from pidtsm_ros.trajectory_cdr import FIELDS, Scan, read_names, scan
from pidtsm_ros.wire import deserialize

_LARGEST_REST = 100_000
"""Bytes of tolerances that are read; rclpy takes a few ms for them."""
_STILL = float(np.finfo(np.float32).eps)
"""A joint of the last point is at rest, rad/s, as joint_trajectory_controller has it."""
_UNREADABLE = "it cannot be read: it is no little-endian CDR, is too short, or a name of a joint is not UTF-8"
_COUNT = struct.Struct("<I")
_DOUBLE = 8
_EMPTY_TRAJECTORY = {
    # Stamp, frame_id, no joints, no points: as long, in multiples of 8 bytes, as what it replaces.
    0: b"\0" * 8 + b"\1\0\0\0\0\0\0\0" + b"\0" * 8,
    4: b"\0" * 8 + b"\5\0\0\0none\0\0\0\0" + b"\0" * 8,
}


@dataclass(frozen=True)
class GoalContent:
    """A goal, its points as arrays.

    Attributes:
        stamp: of the trajectory, ns; 0: at once.
        names: of the joints.
        count: number of points.
        points: what they contain; None if there are more than are read.
        rest: the goal without its trajectory; None if it is larger than what is read, or comes after too many points.
    """

    stamp: int
    names: tuple[str, ...]
    count: int
    points: Scan | None
    rest: Any


def read_goal(data: bytes) -> GoalContent:
    """Read a serialized goal; its points are read by compiled code.

    Raises:
        MessageError: it cannot be read.
    """
    try:
        names, place = read_names(data)
        (count,) = _COUNT.unpack_from(data, place)
    except (struct.error, UnicodeDecodeError, IndexError):
        raise MessageError(_UNREADABLE) from None
    stamp = serialized_nanoseconds(data)
    if count > MOST:
        return GoalContent(stamp, names, count, None, None)
    if (found := scan(data, place, len(names))) is None:
        raise MessageError(_UNREADABLE)
    points, after = found
    begin = _EMPTY_TRAJECTORY[(after - STAMP_BEGIN) % _DOUBLE]
    try:
        # Behind a message, rclpy leaves bytes of others.
        rest = deserialize(data[:STAMP_BEGIN] + begin + data[after : after + _LARGEST_REST], FollowJointTrajectory.Goal)
    except MessageError:
        rest = None
    return GoalContent(stamp, names, count, points, rest)


def rejection(goal: GoalContent, joints: Sequence[str], *, partial: bool, now: int) -> str:
    """Why joint_trajectory_controller would reject a goal (its `validate_trajectory_msg`); empty if it would not.

    Args:
        goal: the goal.
        joints: of the node.
        partial: whether joints may be missing.
        now: ns.
    """
    known = ", ".join(joints)
    if unknown := [name for name in goal.names if name not in joints]:
        return f"unknown joints {', '.join(unknown)}; known: {known}"
    if not goal.names or (not partial and len(goal.names) != len(joints)):
        missing = [name for name in joints if name not in goal.names]
        if not missing:
            return f"{len(goal.names)} names for {len(joints)} joints: {known}"
        return f"joints {', '.join(missing)} are missing; name all, or set allow_partial_joints_goal"
    if not goal.count:
        return "it has no points"
    if goal.points is None:
        return ""  # It is accepted, so that the result can report how many are allowed.
    return _rejection_of_points(goal.names, goal.points) or _rejection_of_times(goal.stamp, goal.points, now)


def _rejection_of_points(names: Sequence[str], points: Scan) -> str:
    joints = len(names)
    for field, name in enumerate(FIELDS[:3]):
        lengths = points.lengths[:, field]
        wrong = lengths != joints
        if field:
            wrong &= lengths != 0
        if wrong.any():
            i = int(np.argmax(wrong))
            return f"{name} of point {i + 1} has {lengths[i]} values for {joints} joints"
    moving = np.abs(points.values[-1, 1]) > _STILL
    if points.lengths[-1, 1] and moving.any():
        j = int(np.argmax(moving))
        return f"it must end at rest; the last point has {points.values[-1, 1, j]:g} as velocity of {names[j]}"
    return ""


def _rejection_of_times(stamp: int, points: Scan, now: int) -> str:
    times = times_of(points)
    if (wrong := np.diff(times) <= 0).any():
        i = int(np.argmax(wrong))
        before, after = (seconds(int(t)) for t in times[i : i + 2])
        return (
            f"time_from_start must increase from point to point; {after:g} s of point {i + 2} comes after {before:g} s"
        )
    if stamp and (over := now - stamp - int(times[-1])) > 0:
        return (
            f"it is over: it ended {over / NANOSECONDS:.3f} s ago by its stamp; give its start on the clock of the "
            "joint states, or 0 for now"
        )
    return ""
