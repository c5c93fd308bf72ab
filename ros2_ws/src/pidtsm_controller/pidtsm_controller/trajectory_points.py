"""The points of a trajectory message as arrays."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pidtsm_core.joints import ABSURD, JointOrder, MessageError
from pidtsm_core.parameters import Array
from pidtsm_core.timing import seconds
from pidtsm_ros.stamps import nanoseconds

MOST = 10_000
"""Number of points that are accepted; rclpy takes a quarter of a second to deserialize as many."""
LONGEST = 3600.0
"""Duration that is accepted, s: checking the limits takes about 1.5 ms for each second."""
_FIELDS = ("positions", "velocities", "accelerations")


def places(names: Sequence[str], joints: Sequence[str], *, partial: bool) -> NDArray[np.intp]:
    """Index in `joints` of each name, shape (names,).

    Args:
        names: of the message.
        joints: of the node.
        partial: whether joints may be missing.

    Raises:
        MessageError: a joint is unknown or named twice, or missing.
    """
    if not partial or len(names) >= len(joints) or not set(names) <= set(joints):
        JointOrder(joints).match(names)
    elif len(set(names)) != len(names) or not names:
        raise MessageError(f"each joint must be named once in [{', '.join(names)}]; expected: {', '.join(joints)}")
    return np.array([list(joints).index(name) for name in names], dtype=np.intp)


def read_points(message: JointTrajectory) -> tuple[Array, Array]:
    """Times from the start, s, shape (n,), and states in the message's order of joints, shape (n, 1 to 3, joints).

    The states are positions and, if given, velocities and accelerations. There is at least one point.

    Raises:
        MessageError: there are too many points, or they take too long; their fields differ, an array has the wrong
            length, or a value is not finite or is absurd.
    """
    points = message.points
    check_extent(len(points), 0.0)
    fields = _fields(points[0])
    for i, point in enumerate(points):
        if _fields(point) != fields:
            raise MessageError(f"point {i + 1} has {', '.join(_fields(point))}; the first has {', '.join(fields)}")
    times = np.array([seconds(nanoseconds(point.time_from_start)) for point in points])
    check_extent(len(points), float(times.max()))
    return times, np.stack([_values(message, field) for field in fields], axis=1)


def check_extent(count: int, duration: float) -> None:
    """Check the number of points, and their largest time (s).

    Raises:
        MessageError: there are too many points, or they take too long.
    """
    if count > MOST:
        raise MessageError(f"{count} points are too many: at most {MOST} are allowed")
    if duration > LONGEST:
        raise MessageError(f"time_from_start reaches {duration:g} s; at most {LONGEST:g} s are allowed")


def read_efforts(message: JointTrajectory) -> Array | None:
    """Efforts of the points in the message's order of joints, shape (n, joints), N m; None if they have none.

    Raises:
        MessageError: an array has the wrong length, or a value is not finite or is absurd.
    """
    return _values(message, "effort") if any(len(point.effort) for point in message.points) else None


def _fields(point: JointTrajectoryPoint) -> tuple[str, ...]:
    """Which of position and its derivatives the point has."""
    fields = tuple(field for field in _FIELDS if len(getattr(point, field)))
    if fields not in (_FIELDS[:1], _FIELDS[:2], _FIELDS):
        raise MessageError(
            f"a point has {', '.join(fields) or 'nothing'}; it needs positions, positions and velocities, "
            "or positions, velocities and accelerations"
        )
    return fields


def _values(message: JointTrajectory, field: str) -> Array:
    """The values of one field, shape (points, joints)."""
    joints = len(message.joint_names)
    for i, point in enumerate(message.points):
        if len(getattr(point, field)) != joints:
            raise MessageError(f"{field} of point {i + 1} has {len(getattr(point, field))} values for {joints} joints")
    values = np.array([getattr(point, field) for point in message.points])
    usable = np.abs(values) < ABSURD
    if not usable.all():
        i, j = np.argwhere(~usable)[0]
        # Without the value: each cause is logged once, and values always differ.
        reason = "is absurd" if np.isfinite(values[i, j]) else "is not finite"
        raise MessageError(f"{field} of point {i + 1} {reason}: {message.joint_names[j]}")
    return values
