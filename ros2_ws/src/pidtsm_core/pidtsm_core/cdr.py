"""How a message lies in its bytes: CDR, as DDS sends it and bags hold it (OMG DDSI-RTPS 2.3, chapter 10).

Where the numbers of a message stand is not computed but found, see `places_of_numbers`.
"""

import math
import struct
from array import array
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.joints import MessageError
from pidtsm_core.parameters import Array
from pidtsm_core.timing import NANOSECONDS

ENCODING = 2
"""Bytes at the beginning that say how the message is encoded; the second tells the byte order."""
STAMP_BEGIN = 4
"""Where the first field stands, after the encoding and two bytes that nobody reads. Integers are aligned to it."""
STAMP_END = STAMP_BEGIN + 8
"""Where the stamp ends in a message that begins with one, alone or in a std_msgs/Header."""
DOUBLE = 8
"""Bytes of a float64."""
LEAD = DOUBLE - STAMP_BEGIN
"""Place of a message among whole words, see `aligned`."""
STAMP = struct.Struct("=iI")
"""A stamp, seconds and nanoseconds, in the byte order of this machine."""

_LITTLE_ENDIAN = 1
_STAMP = {"<": struct.Struct("<4xiI"), ">": struct.Struct(">4xiI")}
_STAMPS = np.dtype([("sec", "<i4"), ("nanosec", "<u4")])
_EMPTY = struct.Struct("<xB10xI")  # byte order, and length of the header's frame_id


def serialized_nanoseconds(data: bytes) -> int:
    """The stamp in ns of a serialized message that begins with a std_msgs/Header.

    Raises:
        MessageError: the message is too short to have one, or its nanoseconds are a second or more.
    """
    if len(data) < STAMP_END:
        raise MessageError(f"{len(data)} bytes are no message")
    sec, nanosec = _STAMP["<" if data[1] == _LITTLE_ENDIAN else ">"].unpack_from(data)
    if nanosec >= NANOSECONDS:
        raise MessageError(f"{nanosec} ns are no part of a second")
    return int(sec * NANOSECONDS + nanosec)


def stamps_of(messages: Sequence[bytes]) -> NDArray[np.int64]:
    """The stamps in ns of little-endian messages that begin with a std_msgs/Header, shape (messages,).

    Raises:
        ValueError: a message is too short to have one.
    """
    encoded = b"".join([data[STAMP_BEGIN:STAMP_END] for data in messages])
    stamps = np.frombuffer(encoded, _STAMPS)
    if stamps.size != len(messages):
        raise ValueError("a message is too short to have a stamp")
    return stamps["sec"] * np.int64(NANOSECONDS) + stamps["nanosec"]


def places_of_numbers(
    message: Any, names: Sequence[str], serialize: Callable[[Any], bytes | memoryview]
) -> tuple[bytes, dict[str, int]]:
    """Find where the numbers of float64 fields stand: a message full of marks is serialized, and the marks looked for.

    Whoever serializes knows the layout of every type, and messages that differ in nothing but numbers share it.

    Args:
        message: the named fields are numbers, or arrays of them, and are overwritten with marks.
        names: of the float64 and float64[] fields.
        serialize: gives the message as CDR.

    Returns:
        The message that was searched, and the place of the first byte of each field; an empty array has none.

    Raises:
        ValueError: the message does not hold each mark once.
    """
    sizes = [np.size(getattr(message, name)) for name in names]
    ends = np.cumsum(sizes, dtype=int).tolist()
    all_marks = _marks(sum(sizes))
    marks = {name: all_marks[end - size : end] for name, size, end in zip(names, sizes, ends, strict=True)}
    for name, numbers in marks.items():
        old = getattr(message, name)
        if isinstance(old, float):
            setattr(message, name, float(numbers[0]))
        else:
            setattr(message, name, numbers if isinstance(old, np.ndarray) else array("d", numbers))
    data = bytes(serialize(message))
    places = {}
    for name, numbers in marks.items():
        if numbers.size:
            pattern = numbers.tobytes()
            if data.count(pattern) != 1:
                raise ValueError(f"the message does not hold the marks of {name} exactly once")
            places[name] = data.index(pattern)
    return data, places


def _marks(count: int) -> Array:
    """Integers that occur nowhere else in a message."""
    return np.arange(1, count + 1, dtype=np.float64) * np.float64(-math.pi * 1e-200)


def end_of_empty(data: bytes, sequences: int) -> int:
    """Bytes of a message of a std_msgs/Header and so many sequences if all of these are empty, else 0.

    What follows is of any value: Fast CDR leaves bytes behind such a message, for which others take it as damaged.
    Only a little-endian message is recognized.
    """
    if len(data) < _EMPTY.size:
        return 0
    byte_order, length = _EMPTY.unpack_from(data)
    begin = (_EMPTY.size + length + 3) // 4 * 4
    end = begin + 4 * sequences
    return end if byte_order == _LITTLE_ENDIAN and data[begin:end] == bytes(4 * sequences) else 0


def aligned(length: int) -> NDArray[np.uint8]:
    """Zeros for a message of so many bytes that begins at `LEAD`, in whole words, shape (bytes,).

    The float64 of the message stand at whole words then.
    """
    return np.zeros(-(-(LEAD + length) // DOUBLE) * DOUBLE, np.uint8)
