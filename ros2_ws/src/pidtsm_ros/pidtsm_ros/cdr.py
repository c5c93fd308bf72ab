"""Binary layout of messages: CDR, as sent by DDS and stored in bags (OMG DDSI-RTPS 2.3, chapter 10).

The offsets of the numbers in a message are searched for rather than computed, see `places_of_numbers`.
"""

import math
import struct
from array import array
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.timing import NANOSECONDS

ENCODING = 2
"""Number of bytes for the encoding at the beginning; the second byte is the byte order."""
STAMP_BEGIN = 4
"""Offset of the first field, after the encoding and two unused bytes. Integers are aligned relative to it."""
STAMP_END = STAMP_BEGIN + 8
"""End of the stamp in a message that begins with one, alone or in a std_msgs/Header."""
DOUBLE = 8
"""Bytes of a float64."""
LEAD = DOUBLE - STAMP_BEGIN
"""Offset of a message in a buffer of whole words, see `aligned`."""
STAMP = struct.Struct("=iI")
"""A stamp, seconds and nanoseconds, in the byte order of this machine."""

_LITTLE_ENDIAN = 1
_STAMP = {"<": struct.Struct("<4xiI"), ">": struct.Struct(">4xiI")}
_STAMPS = np.dtype([("sec", "<i4"), ("nanosec", "<u4")])
_EMPTY = struct.Struct("<xB10xI")  # byte order, and length of the header's frame_id


def serialized_nanoseconds(data: bytes) -> int:
    """The stamp in ns of a serialized message that begins with a std_msgs/Header.

    Raises:
        MessageError: the message is too short for a stamp, or its nanoseconds are a second or more.
    """
    if len(data) < STAMP_END:
        raise MessageError(f"{len(data)} bytes are too short for a message")
    sec, nanosec = _STAMP["<" if data[1] == _LITTLE_ENDIAN else ">"].unpack_from(data)
    if nanosec >= NANOSECONDS:
        raise MessageError(f"invalid stamp: {nanosec} ns are a second or more")
    return int(sec * NANOSECONDS + nanosec)


def stamps_of(messages: Sequence[bytes]) -> NDArray[np.int64]:
    """The stamps in ns of little-endian messages that begin with a std_msgs/Header, shape (messages,).

    Raises:
        ValueError: a message is too short for a stamp.
    """
    encoded = b"".join([data[STAMP_BEGIN:STAMP_END] for data in messages])
    stamps = np.frombuffer(encoded, _STAMPS)
    if stamps.size != len(messages):
        raise ValueError("a message is too short for a stamp")
    return stamps["sec"] * np.int64(NANOSECONDS) + stamps["nanosec"]


def places_of_numbers(
    message: Any, names: Sequence[str], serialize: Callable[[Any], bytes | memoryview]
) -> tuple[bytes, dict[str, int]]:
    """Find the offsets of float64 fields by serializing a message with unique marks and searching for them.

    The serializer knows the layout of every type, and messages that differ only in numbers have the same layout.

    Args:
        message: its named fields are floats or arrays of floats; they are overwritten with marks.
        names: names of the float64 and float64[] fields.
        serialize: returns the message as CDR.

    Returns:
        The serialized message with the marks, and the offset of the first byte of each field; none for empty arrays.

    Raises:
        ValueError: the message does not contain each mark exactly once.
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
                raise ValueError(f"the message does not contain the marks of {name} exactly once")
            places[name] = data.index(pattern)
    return data, places


def _marks(count: int) -> Array:
    """Numbers that occur nowhere else in a message."""
    return np.arange(1, count + 1, dtype=np.float64) * np.float64(-math.pi * 1e-200)


class Layout(NamedTuple):
    """Where the numbers are in messages that are alike: they differ only in their stamp and their numbers.

    Attributes:
        shared: whether a byte is the same in all of them, shape (bytes,).
        places: offset of the first byte of each float64 field; none for empty arrays.
    """

    shared: NDArray[np.bool_]
    places: dict[str, int]


def layout_of(
    data: bytes, message: Any, names: Sequence[str], serialize: Callable[[Any], bytes | memoryview]
) -> Layout:
    """The layout of the messages that are like this one.

    What is behind the message is not part of it: `serialize_message` of rclpy appends arbitrary bytes.

    Args:
        data: the serialized message, which begins with a std_msgs/Header.
        message: the same, deserialized; its numbers are overwritten.
        names: names of its float64 and float64[] fields.
        serialize: returns a message as CDR.

    Raises:
        ValueError: the message was serialized in another way.
    """
    sizes = {name: np.size(getattr(message, name)) for name in names}
    marked, places = places_of_numbers(message, names, serialize)
    if len(marked) > len(data) or marked[:ENCODING] != data[:ENCODING]:
        raise ValueError("the message was serialized in another way")
    shared = np.ones(len(data), np.bool_)
    shared[ENCODING:STAMP_END] = shared[len(marked) :] = False
    for name, place in places.items():
        shared[place : place + DOUBLE * sizes[name]] = False
    return Layout(shared, places)


class NumberTable:
    """Reads numbers from many messages at once, if they are like one that is known."""

    def __init__(self, data: bytes, shared: NDArray[np.bool_], places: Sequence[int]) -> None:
        """Prepare the table.

        Args:
            data: the message that is known.
            shared: see `Layout`.
            places: offsets of the numbers to read.
        """
        self.length = len(data)
        self._shared = np.flatnonzero(shared)
        self._known = np.frombuffer(data, np.uint8)[self._shared]
        self._bytes = np.add.outer(np.asarray(places, np.intp), np.arange(DOUBLE)).ravel()

    def read(self, messages: Sequence[bytes]) -> tuple[NDArray[np.bool_], Array]:
        """Read messages of the same length.

        Returns:
            Whether each is like the known one, shape (messages,), and the numbers of those that are, shape
            (messages, places).
        """
        table = np.frombuffer(b"".join(messages), np.uint8).reshape(len(messages), self.length)
        alike = (table[:, self._shared] == self._known).all(axis=1)
        rows = table if alike.all() else table[alike]
        if not self._bytes.size:
            return alike, np.empty((len(rows), 0))
        return alike, rows.take(self._bytes, axis=1).view("<f8")


def end_of_empty(data: bytes, sequences: int) -> int:
    """Length in bytes of a message of a std_msgs/Header and so many sequences if all of them are empty, else 0.

    Fast CDR appends arbitrary bytes to such a message, so that other implementations consider it damaged.
    Only little-endian messages are recognized.
    """
    if len(data) < _EMPTY.size:
        return 0
    byte_order, length = _EMPTY.unpack_from(data)
    begin = (_EMPTY.size + length + 3) // 4 * 4
    end = begin + 4 * sequences
    return end if byte_order == _LITTLE_ENDIAN and data[begin:end] == bytes(4 * sequences) else 0


def aligned(length: int) -> NDArray[np.uint8]:
    """Zeroed buffer of whole words for a message of `length` bytes at offset `LEAD`, shape (bytes,).

    This aligns the float64 of the message to whole words.
    """
    return np.zeros(-(-(LEAD + length) // DOUBLE) * DOUBLE, np.uint8)
