"""The points of a trajectory message as arrays."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from trajectory_msgs.msg import JointTrajectory

from pidtsm_core.arrays import Array
from pidtsm_core.parameters.joints import ABSURD, JointOrder, MessageError
from pidtsm_core.timing import NANOSECONDS
from pidtsm_ros.trajectory_cdr import FIELDS, Scan

MOST = 50_000
"""Number of points that are accepted; to receive as many as a goal holds the loop up for some 30 ms."""
LONGEST = 3600.0
"""Duration that is accepted, s: checking the limits takes about 1.5 ms for each second."""
_STATES = FIELDS[:3]
_EFFORT = 3


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


def joint_values(field: str, given: Sequence[float], joints: int) -> Array:
    """The values of a field, one for each of `joints` joints, shape (joints,).

    Raises:
        MessageError: their number is wrong, or one is not finite or is absurd.
    """
    values = np.array(given, dtype=np.float64)
    if values.size != joints:
        raise MessageError(f"{field} has {values.size} values for {joints} joints")
    if not (np.abs(values) < ABSURD).all():
        raise MessageError(f"{field} is not finite, or absurd")
    return values


def read_points(message: JointTrajectory) -> tuple[Array, Array]:
    """Times and states of a message in its order of joints, see `states_of`. There is at least one point.

    Raises:
        MessageError: see `states_of`.
    """
    points, joints = message.points, len(message.joint_names)
    check_extent(len(points), 0.0)
    clock = np.array([(p.time_from_start.sec, p.time_from_start.nanosec) for p in points], dtype=np.int64)
    lengths = np.array([[len(getattr(point, field)) for field in FIELDS] for point in points], dtype=np.int64)
    values = np.zeros((len(points), len(FIELDS), joints))
    for i, point in enumerate(points):
        for k, field in enumerate(FIELDS):
            if lengths[i, k] == joints:
                values[i, k] = getattr(point, field)
    return states_of(message.joint_names, Scan(clock, lengths, values))


def times_of(points: Scan) -> NDArray[np.int64]:
    """Times from the start, ns, shape (n,)."""
    return points.clock[:, 0] * NANOSECONDS + points.clock[:, 1]


def states_of(names: Sequence[str], points: Scan) -> tuple[Array, Array]:
    """Times from the start, s, shape (n,), and states in the order of `names`, shape (n, 1 to 3, joints).

    The states are positions and, if given, velocities and accelerations.

    Args:
        names: of the joints.
        points: at least one.

    Raises:
        MessageError: there are too many points, or they take too long; their fields differ, an array has the wrong
            length, or a value is not finite or is absurd.
    """
    check_extent(len(points.clock), 0.0)
    given = points.lengths[:, :_EFFORT] > 0
    first = _fields(given[0])
    if (others := (given != given[0]).any(axis=1)).any():
        i = int(np.argmax(others))
        raise MessageError(f"point {i + 1} has {', '.join(_fields(given[i]))}; the first has {', '.join(first)}")
    times = times_of(points) / NANOSECONDS
    check_extent(len(times), float(times.max()))
    for field in range(len(first)):
        _check_values(names, points, field)
    return times, points.values[:, : len(first)]


def check_extent(count: int, duration: float) -> None:
    """Check the number of points, and their largest time (s).

    Raises:
        MessageError: there are too many points, or they take too long.
    """
    if count > MOST:
        raise MessageError(f"{count} points are too many: at most {MOST} are allowed")
    if duration > LONGEST:
        raise MessageError(f"time_from_start reaches {duration:g} s; at most {LONGEST:g} s are allowed")


def efforts_of(names: Sequence[str], points: Scan) -> Array | None:
    """Efforts of the points in the order of `names`, shape (n, joints), N m; None if they have none.

    Raises:
        MessageError: an array has the wrong length, or a value is not finite or is absurd.
    """
    if not points.lengths[:, _EFFORT].any():
        return None
    _check_values(names, points, _EFFORT)
    return points.values[:, _EFFORT]


def _fields(given: NDArray[np.bool_]) -> tuple[str, ...]:
    """Which of position and its derivatives a point has."""
    fields = tuple(field for field, there in zip(_STATES, given, strict=True) if there)
    if fields not in (_STATES[:1], _STATES[:2], _STATES):
        raise MessageError(
            f"a point has {', '.join(fields) or 'nothing'}; it needs positions, positions and velocities, "
            "or positions, velocities and accelerations"
        )
    return fields


def _check_values(names: Sequence[str], points: Scan, field: int) -> None:
    """Check the values of one field."""
    lengths, joints = points.lengths[:, field], len(names)
    if (wrong := lengths != joints).any():
        i = int(np.argmax(wrong))
        raise MessageError(f"{FIELDS[field]} of point {i + 1} has {lengths[i]} values for {joints} joints")
    values = points.values[:, field]
    usable = np.abs(values) < ABSURD
    if not usable.all():
        i, j = np.argwhere(~usable)[0]
        # Without the value: each cause is logged once, and values always differ.
        reason = "is absurd" if np.isfinite(values[i, j]) else "is not finite"
        raise MessageError(f"{FIELDS[field]} of point {i + 1} {reason}: {names[j]}")
