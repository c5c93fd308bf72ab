"""ROS time stamps as integer nanoseconds."""

from builtin_interfaces.msg import Time

from pidtsm_core.timing import NANOSECONDS


def nanoseconds(stamp: Time) -> int:
    """The stamp in ns."""
    return int(stamp.sec * NANOSECONDS + stamp.nanosec)


def set_stamp(stamp: Time, ns: int) -> None:
    """Write ns into the stamp."""
    stamp.sec, stamp.nanosec = divmod(ns, NANOSECONDS)
