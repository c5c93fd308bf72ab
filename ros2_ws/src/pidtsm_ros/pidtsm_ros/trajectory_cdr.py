"""The points of a serialized trajectory_msgs/JointTrajectory, read by compiled code without the GIL.

rclpy makes objects of all points, which takes 25 us each and stops every thread of the process meanwhile. Of the topic
``joint_trajectory``, messages that are not as most senders write them are left to it, and so are those with a mistake,
for its messages; goals of actions are read here, whatever they contain.
"""

import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import subroutine
from pidtsm_core.timing import NANOSECONDS
from pidtsm_ros.cdr import LEAD, STAMP_BEGIN, STAMP_END, aligned, serialized_nanoseconds

FIELDS = ("positions", "velocities", "accelerations", "effort")
"""Fields of a point, in the order of all arrays here."""
_LITTLE_ENDIAN = 1
_WORD = 4
_LONGEST_NAME, _MOST_JOINTS = 10_000, 1000
_LENGTH = struct.Struct("<I")


class Scan(NamedTuple):
    """Points as they were sent, whatever they contain.

    Attributes:
        clock: seconds and nanoseconds from the start, shape (n, 2).
        lengths: number of values of each field, shape (n, 4).
        values: of the fields that have one value for each joint, shape (n, 4, joints).
    """

    clock: NDArray[np.int64]
    lengths: NDArray[np.int64]
    values: Array


class Points(NamedTuple):
    """A trajectory whose points all have the same fields.

    Attributes:
        stamp: ns.
        names: of the joints.
        times: from the start, s, shape (n,).
        states: positions and, if given, velocities and accelerations, in the order of `names`, shape
            (n, 1 to 3, joints).
    """

    stamp: int
    names: tuple[str, ...]
    times: Array
    states: Array


def read_serialized(data: bytes) -> Points | None:
    """The points of a message; None if rclpy has to read it."""
    try:
        names, place = read_names(data)
        (count,) = _LENGTH.unpack_from(data, place)
    except (struct.error, UnicodeDecodeError):
        return None
    if not names or not count or (found := scan(data, place, len(names))) is None:
        return None
    (clock, lengths, values), _ = found
    given = int((lengths[0, :3] > 0).sum())
    if not given or (lengths != lengths[0]).any() or (lengths[0, :given] != len(names)).any():
        return None
    if lengths[0, 3] not in (0, len(names)):
        return None
    if (clock[:, 0] < 0).any() or (clock[:, 1] >= NANOSECONDS).any() or not np.isfinite(values[:, :given]).all():
        return None
    times = (clock[:, 0] * NANOSECONDS + clock[:, 1]) / NANOSECONDS
    return Points(serialized_nanoseconds(data), names, times, values[:, :given].copy())


def read_names(data: bytes) -> tuple[tuple[str, ...], int]:
    """Names of the joints, and the place of the number of points.

    Raises:
        struct.error: the message is too short, or has more joints than any arm.
        UnicodeDecodeError: a name is not UTF-8.
    """
    (length,) = _LENGTH.unpack_from(data, STAMP_END)
    place = _aligned(STAMP_END + _WORD + length)
    (count,) = _LENGTH.unpack_from(data, place)
    if count > _MOST_JOINTS:
        raise struct.error(f"{count} joints")
    names, place = [], place + _WORD
    for _ in range(count):
        (length,) = _LENGTH.unpack_from(data, place)
        begin = place + _WORD
        names.append(data[begin : begin + min(length, _LONGEST_NAME) - 1].decode() if length else "")
        place = _aligned(begin + length)
    return tuple(names), place


def scan(data: bytes, place: int, joints: int) -> tuple[Scan, int] | None:
    """All points, and the place of the first byte after them; None if the bytes are not such a message.

    Args:
        data: the message, little-endian.
        place: of the number of points.
        joints: number of names.
    """
    if data[1] != _LITTLE_ENDIAN or len(data) < place + _WORD:
        return None
    (count,) = _LENGTH.unpack_from(data, place)
    if count > len(data) // ((len(FIELDS) + 2) * _WORD):
        return None
    buffer = aligned(len(data))
    buffer[LEAD : LEAD + len(data)] = np.frombuffer(data, np.uint8)
    clock, lengths = np.zeros((count, 2), np.int64), np.zeros((count, len(FIELDS)), np.int64)
    values = np.zeros((count, len(FIELDS), joints))
    end = (LEAD + len(data)) // _WORD
    words, first = buffer.view(np.uint32), (LEAD + place) // _WORD + 1
    after = _scan(words, buffer.view(np.float64), first, end, clock, lengths, values)
    return (Scan(clock, lengths, values), after * _WORD - LEAD) if after >= 0 else None


def _aligned(place: int) -> int:
    return STAMP_BEGIN + -(-(place - STAMP_BEGIN) // _WORD) * _WORD


@subroutine
def _scan(
    words: NDArray[np.uint32],
    doubles: Array,
    place: int,
    end: int,
    clock: NDArray[np.int64],
    lengths: NDArray[np.int64],
    values: Array,
) -> int:
    """Read all points; returns the word after them, -1 if the message is too short.

    Args:
        words: the message, shape (words,); doubles are aligned to two of them.
        doubles: the same, shape (words / 2,).
        place: word of the first point.
        end: first word after the message.
        clock: result, see `Scan`.
        lengths: result.
        values: result.
    """
    joints = values.shape[2]
    for k in range(clock.shape[0]):
        for field in range(4):
            if place >= end:
                return -1
            length = int(words[place])
            lengths[k, field] = length
            place += 1
            if length:
                place += place % 2
                if place + 2 * length > end:
                    return -1
                if length == joints:
                    for j in range(length):
                        values[k, field, j] = doubles[place // 2 + j]
                place += 2 * length
        if place + 2 > end:
            return -1
        seconds = int(words[place])
        clock[k, 0] = seconds - 4294967296 if seconds >= 2147483648 else seconds
        clock[k, 1] = int(words[place + 1])
        place += 2
    return place
