"""ROS time stamps as integer nanoseconds."""

import struct

from builtin_interfaces.msg import Time

from pidtsm_core.timing import NANOSECONDS


def nanoseconds(stamp: Time) -> int:
    """The stamp in ns."""
    return int(stamp.sec * NANOSECONDS + stamp.nanosec)


_LITTLE_ENDIAN = 1
_CDR_HEADER = 4  # bytes before the first field; the second tells the byte order (DDSI-RTPS 10.2)


def serialized_nanoseconds(data: bytes) -> int:
    """The stamp in ns of a serialized message that begins with a std_msgs/Header."""
    order = "<" if data[1] == _LITTLE_ENDIAN else ">"
    sec, nanosec = struct.unpack_from(f"{order}iI", data, _CDR_HEADER)
    return int(sec * NANOSECONDS + nanosec)


def set_stamp(stamp: Time, ns: int) -> None:
    """Write ns into the stamp."""
    stamp.sec, stamp.nanosec = divmod(ns, NANOSECONDS)
