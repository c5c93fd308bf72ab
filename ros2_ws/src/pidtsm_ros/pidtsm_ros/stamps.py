"""ROS time stamps as integer nanoseconds."""

import struct

from builtin_interfaces.msg import Time

from pidtsm_core.joints import MessageError
from pidtsm_core.timing import NANOSECONDS


def nanoseconds(stamp: Time) -> int:
    """The stamp in ns."""
    return int(stamp.sec * NANOSECONDS + stamp.nanosec)


_LITTLE_ENDIAN = 1
_CDR_HEADER = 4  # bytes before the first field; the second tells the byte order (DDSI-RTPS 10.2)
STAMP_END = _CDR_HEADER + 8
"""Bytes of a serialized message that begins with a stamp, up to its end."""
_STAMP = {"<": struct.Struct("<4xiI"), ">": struct.Struct(">4xiI")}


def serialized_nanoseconds(data: bytes) -> int:
    """The stamp in ns of a serialized message that begins with a std_msgs/Header.

    Raises:
        MessageError: the message is too short to have one, or its nanoseconds are more than a second.
    """
    if len(data) < STAMP_END:
        raise MessageError(f"{len(data)} bytes are no message")
    sec, nanosec = _STAMP["<" if data[1] == _LITTLE_ENDIAN else ">"].unpack_from(data)
    if nanosec >= NANOSECONDS:
        raise MessageError(f"{nanosec} ns are no part of a second")
    return int(sec * NANOSECONDS + nanosec)


def set_stamp(stamp: Time, ns: int) -> None:
    """Write ns into the stamp."""
    stamp.sec, stamp.nanosec = divmod(ns, NANOSECONDS)
