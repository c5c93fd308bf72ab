"""Stamps survive the way to a message, over the wire and back."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from pidtsm_core.joints import MessageError
from pidtsm_ros.stamps import nanoseconds, serialized_nanoseconds, set_stamp

STAMPS = st.integers(min_value=0, max_value=(2**31 - 1) * 10**9 + 999_999_999)


@given(STAMPS)
def test_a_stamp_is_read_as_written(ns: int) -> None:
    message = JointState()
    set_stamp(message.header.stamp, ns)
    assert nanoseconds(message.header.stamp) == ns
    assert serialized_nanoseconds(serialize_message(message)) == ns


def test_big_endian_messages_are_read_too() -> None:
    assert serialized_nanoseconds(struct.pack(">4B i I", 0, 0, 0, 0, 12, 34)) == 12_000_000_034


def test_nanoseconds_are_less_than_a_second() -> None:
    with pytest.raises(MessageError, match="1000000000 ns are no part of a second"):
        serialized_nanoseconds(struct.pack("<4B i I", 0, 1, 0, 0, 2**31 - 1, 10**9))
