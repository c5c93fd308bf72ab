"""A stamp written to a message is read back unchanged, also from the serialized message."""

from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.stamps import nanoseconds, set_stamp

STAMPS = st.integers(min_value=0, max_value=(2**31 - 1) * 10**9 + 999_999_999)


@given(STAMPS)
def test_a_stamp_is_read_as_written(ns: int) -> None:
    message = JointState()
    set_stamp(message.header.stamp, ns)
    assert nanoseconds(message.header.stamp) == ns
    assert serialized_nanoseconds(serialize_message(message)) == ns
