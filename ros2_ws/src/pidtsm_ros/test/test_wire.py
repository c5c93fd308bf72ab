"""Messages written and read as bytes match rclpy's bit for bit."""

import math
import struct
from array import array
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from pidtsm_core.parameters.joints import MessageError
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.serialization import serialize
from pidtsm_ros.stamps import nanoseconds, set_stamp
from pidtsm_ros.wire import IncomingMessages, OutgoingMessage

NAMES = st.lists(st.text("jointé_1", min_size=1, max_size=9), min_size=1, max_size=7, unique=True)
NUMBERS = st.floats(allow_subnormal=True, width=64)
REFERENCE = ("position", "velocity", "acceleration", "effort")
STATE = tuple(n for n, t in ControllerState.get_fields_and_field_types().items() if t == "sequence<double>")
SCALARS = tuple(n for n, t in ControllerState.get_fields_and_field_types().items() if t == "double")


def content(message: Any) -> list[Any]:
    """The fields, numbers as bits; serialized messages may differ in their padding, which rclpy does not initialise."""
    fields = [getattr(message, name) for name in message.get_fields_and_field_types()]
    return [np.array(f).tobytes() if isinstance(f, (array, float)) else f for f in fields]


@settings(max_examples=20, deadline=None)
@given(st.data(), NAMES, st.sampled_from(["", "base", "a frame"]))
def test_outgoing_bytes_are_those_of_rclpy(data: st.DataObject, names: list[str], frame: str) -> None:
    for kind, arrays, scalars in (
        (JointState, ("position",), ()),
        (JointState, ("effort",), ()),
        (JointState, ("position", "velocity", "effort"), ()),
        (JointReference, REFERENCE, ()),
        (ControllerState, STATE, SCALARS),
    ):
        message, again = kind(name=names), kind(name=names)
        message.header.frame_id = again.header.frame_id = frame
        outgoing = OutgoingMessage(message, arrays, scalars, len(names))
        for stamp in (0, 1_999_999_999, 1_700_000_000_123_456_789):
            seed = data.draw(st.integers(0, 2**32))
            outgoing.arrays[:] = np.random.default_rng(seed).normal(size=outgoing.arrays.shape)
            outgoing.arrays.flat[0] = data.draw(NUMBERS)
            outgoing.set_scalars(*[seed / 7] * len(scalars))
            set_stamp(again.header.stamp, stamp)
            for name, row in zip(arrays, outgoing.arrays, strict=True):
                setattr(again, name, row.tolist())
            for name in scalars:
                setattr(again, name, seed / 7)
            written = outgoing.to_bytes(stamp)
            assert written == serialize(again)
            assert content(deserialize_message(written, kind)) == content(again)


def test_a_stamp_alone() -> None:
    message = deserialize_message(OutgoingMessage(Clock()).to_bytes(5_000_000_007), Clock)
    assert nanoseconds(message.clock) == 5_000_000_007


def test_codes_are_written_in_place_and_nothing_else_changes() -> None:
    codes = ("mode", "fault", "fault_joint", "violations")
    outgoing = OutgoingMessage(ControllerState(name=["a", "b"]), STATE, SCALARS, 2, codes)
    blank = content(deserialize_message(outgoing.to_bytes(7), ControllerState))
    for values in ((2, 5, 0, 7), (0, 255, 1, 0)):
        outgoing.set_codes(*values)
        message = deserialize_message(outgoing.to_bytes(7), ControllerState)
        assert tuple(getattr(message, name) for name in codes) == values
        for name in codes:
            setattr(message, name, 0)
        assert content(message) == blank


def test_a_message_without_a_stamp() -> None:
    outgoing = OutgoingMessage(Float64MultiArray(), ("data",), joints=2)
    outgoing.arrays[0] = [1.5, -2.0]
    message = deserialize_message(outgoing.to_bytes(5_000_000_007), Float64MultiArray)
    assert message == Float64MultiArray(data=[1.5, -2.0])


def serialized(names: list[str], position: list[float], velocity: list[float], effort: list[float] = []) -> bytes:  # noqa: B006
    message = JointState(name=names, position=position, velocity=velocity, effort=effort)
    set_stamp(message.header.stamp, 123)
    return bytes(serialize_message(message))


OWN = ["shoulder", "elbow"]
USABLE = [
    (serialized(OWN, [1.0, 2.0], []), [1.0, 2.0]),
    (serialized(OWN, [1.0, 3.0], []), [1.0, 3.0]),
    (serialized(OWN[::-1], [1.0, 2.0], []), [2.0, 1.0]),
    (serialized(OWN, [0.0, -0.0], [5.0, 6.0]), [0.0, -0.0]),
    (serialized(OWN, [7.0, 8.0], [5.0, 6.0], [1.0]), [7.0, 8.0]),
    (serialized(OWN, [7.0, 8.0], [], [1.0, math.nan]), [7.0, 8.0]),
]
UNUSABLE = [
    (serialized(OWN, [1.0, math.nan], []), "position is not finite"),
    (serialized(OWN, [1.0, -math.inf], []), "position is not finite"),
    (serialized(OWN, [1e9, 0.0], []), "position is absurd"),
    (serialized(OWN, [], [1.0, 2.0]), "position has 0 values for 2 joints"),
    (serialized(["shoulder", "wrist"], [1.0, 2.0], []), "unknown joints wrist, missing elbow"),
    (serialized([], [1.0, 2.0], []), "are missing"),
    (USABLE[0][0][:30], "cannot be deserialized"),
]


@settings(deadline=None)
@given(st.lists(st.sampled_from(USABLE + UNUSABLE), max_size=12))
def test_incoming_messages_are_read_whatever_came_before(messages: list[tuple[bytes, list[float] | str]]) -> None:
    incoming, target = IncomingMessages(JointState, ["position"], OWN), np.zeros((1, 2))
    for data, expected in messages:
        for _ in range(2):
            before = target.copy()
            if isinstance(expected, str):
                with pytest.raises(MessageError, match=expected):
                    incoming.read(data, target)
                assert target.tobytes() == before.tobytes()
            else:
                incoming.read(data, target)
                assert target.tobytes() == np.array([expected]).tobytes()


def test_several_fields_are_read_in_the_requested_order() -> None:
    incoming, target = IncomingMessages(JointReference, REFERENCE[::-1], OWN), np.zeros((4, 2))
    for factor in (1.0, 2.0):
        values = [[factor, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0]]
        message = JointReference(name=OWN[::-1], **dict(zip(REFERENCE, values, strict=True)))
        incoming.read(serialize_message(message), target)
        assert target.tolist() == [row[::-1] for row in values[::-1]]


@settings(deadline=None)
@given(st.lists(st.sampled_from([[], [1.0, -2.0], [1.0], [1.0, math.nan], [1e9, 0.0]]), max_size=8))
def test_an_optional_field_may_be_empty(efforts: list[list[float]]) -> None:
    incoming, target = IncomingMessages(JointReference, REFERENCE, OWN, ("effort",)), np.ones((4, 2))
    for effort in efforts:
        message = JointReference(name=OWN, **{name: [0.5, 1.5] for name in REFERENCE[:3]}, effort=effort)
        before = target.copy()
        if effort in ([], [1.0, -2.0]):
            incoming.read(serialize_message(message), target)
            assert target.tolist() == [[0.5, 1.5]] * 3 + [effort or [0.0, 0.0]]
        else:
            with pytest.raises(MessageError, match=r"effort (has 1 values for 2|is not finite|is absurd)"):
                incoming.read(serialize_message(message), target)
            assert target.tobytes() == before.tobytes()


def test_joints_of_others_are_ignored_where_they_may_be() -> None:
    incoming, target = IncomingMessages(JointState, ["position"], OWN, others=True), np.zeros((1, 2))
    for scale in (1.0, 2.0, 3.0):
        incoming.read(serialized(["finger", *OWN[::-1], "thumb"], [math.nan, scale, 2.0 * scale, 1e9], []), target)
        assert target.tolist() == [[2.0 * scale, scale]]
    incoming.read(serialized(OWN, [5.0, 6.0], []), target)
    assert target.tolist() == [[5.0, 6.0]]
    for names, reason in ((["finger", OWN[0]], "missing"), (["finger", *OWN, OWN[0]], "named twice")):
        with pytest.raises(MessageError, match=reason):
            incoming.read(serialized(names, [1.0] * len(names), []), target)
    with pytest.raises(MessageError, match="position has 2 values for 3 joints"):
        incoming.read(serialized(["finger", *OWN], [1.0, 2.0], []), target)


def test_other_byte_orders_are_read_too() -> None:
    big = struct.pack(">4B iI I1s3x I I2s2x I d II", 0, 0, 0, 0, 0, 123, 1, b"\0", 1, 2, b"j\0", 1, 0.5, 0, 0)
    incoming, target = IncomingMessages(JointState, ["position"], ["j"]), np.zeros((1, 1))
    for _ in range(2):
        incoming.read(big, target)
        assert target.tolist() == [[0.5]]
