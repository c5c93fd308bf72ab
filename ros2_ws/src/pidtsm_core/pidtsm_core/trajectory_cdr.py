"""The points of a serialized trajectory_msgs/JointTrajectory, read by compiled code without the GIL.

rclpy makes objects of all points, which takes 25 us each and stops every thread of the process meanwhile. Messages that
are not as most senders write them are left to it, and so are those with a mistake, for its messages.
"""

import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.cdr import LEAD, STAMP_BEGIN, STAMP_END, aligned, serialized_nanoseconds
from pidtsm_core.compiled import subroutine
from pidtsm_core.parameters import Array

_FIELDS = 4
"""Positions, velocities, accelerations, efforts."""
_LITTLE_ENDIAN = 1
_WORD = 4
_LONGEST_NAME, _MOST_JOINTS = 10_000, 1000
_LENGTH = struct.Struct("<I")


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
        names, place = _names(data)
        (count,) = _LENGTH.unpack_from(data, place)
    except (struct.error, UnicodeDecodeError):
        return None
    joints = len(names)
    if data[1] != _LITTLE_ENDIAN or not 0 < joints <= _MOST_JOINTS or not 0 < count <= len(data) // (5 * _WORD):
        return None
    buffer = aligned(len(data))
    buffer[LEAD : LEAD + len(data)] = np.frombuffer(data, np.uint8)
    lengths = np.zeros(_FIELDS, np.int64)
    times, values = np.empty(count), np.empty((count, _FIELDS, joints))
    end = (LEAD + len(data)) // _WORD
    words, first = buffer.view(np.uint32), (LEAD + place) // _WORD + 1
    if not _read(words, buffer.view(np.float64), first, end, lengths, times, values):
        return None
    given = int((lengths[:3] > 0).sum())
    if not given or (lengths[:given] != joints).any() or not np.isfinite(values[:, :given]).all():
        return None
    return Points(serialized_nanoseconds(data), names, times, values[:, :given].copy())


def _names(data: bytes) -> tuple[tuple[str, ...], int]:
    """Names of the joints, and the place of the number of points."""
    (length,) = _LENGTH.unpack_from(data, STAMP_END)
    place = _aligned(STAMP_END + _WORD + length)
    (count,) = _LENGTH.unpack_from(data, place)
    names, place = [], place + _WORD
    for _ in range(min(count, _MOST_JOINTS)):
        (length,) = _LENGTH.unpack_from(data, place)
        begin = place + _WORD
        names.append(data[begin : begin + min(length, _LONGEST_NAME) - 1].decode() if length else "")
        place = _aligned(begin + length)
    return tuple(names), place


def _aligned(place: int) -> int:
    return STAMP_BEGIN + -(-(place - STAMP_BEGIN) // _WORD) * _WORD


@subroutine
def _read(
    words: NDArray[np.uint32],
    doubles: Array,
    place: int,
    end: int,
    lengths: NDArray[np.int64],
    times: Array,
    values: Array,
) -> bool:
    """Read all points; false if the message is too short or its points differ in their fields.

    Args:
        words: the message, shape (words,); doubles are aligned to two of them.
        doubles: the same, shape (words / 2,).
        place: word of the first point.
        end: first word after the message.
        lengths: number of values of each field, shape (4,); those of the first point are written.
        times: result, s, shape (n,).
        values: result, shape (n, 4, joints).
    """
    joints = values.shape[2]
    for k in range(times.size):
        for field in range(4):
            if place >= end:
                return False
            length = int(words[place])
            place += 1
            if k == 0:
                lengths[field] = length
            if length != lengths[field] or length > joints:
                return False
            if length:
                place += place % 2
                if place + 2 * length > end:
                    return False
                for j in range(length):
                    values[k, field, j] = doubles[place // 2 + j]
                place += 2 * length
        if place + 2 > end:
            return False
        seconds, nanoseconds = int(words[place]), int(words[place + 1])
        if seconds >= 2147483648 or nanoseconds >= 1000000000:
            return False
        times[k] = (seconds * 1000000000 + nanoseconds) / 1e9
        place += 2
    return True
