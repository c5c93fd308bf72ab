"""Stamps, numbers and empty messages are found at their places in CDR."""

import struct
from array import array
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pidtsm_core.parameters.joints import MessageError
from pidtsm_ros.cdr import (
    LEAD,
    NumberTable,
    aligned,
    end_of_empty,
    layout_of,
    places_of_numbers,
    serialized_nanoseconds,
    stamps_of,
)


def stamped(byte_order: str, sec: int, nanosec: int) -> bytes:
    return struct.pack(f"{byte_order}4B i I", 0, byte_order == "<", 0, 0, sec, nanosec)


@pytest.mark.parametrize("byte_order", "<>")
def test_stamps_are_read_in_both_byte_orders(byte_order: str) -> None:
    assert serialized_nanoseconds(stamped(byte_order, 12, 34)) == 12_000_000_034


def test_nanoseconds_are_less_than_a_second() -> None:
    with pytest.raises(MessageError, match="1000000000 ns are a second or more"):
        serialized_nanoseconds(stamped("<", 2**31 - 1, 10**9))


def test_a_message_that_is_too_short_has_no_stamp() -> None:
    message = stamped("<", 12, 34)
    with pytest.raises(MessageError, match="11 bytes are too short for a message"):
        serialized_nanoseconds(message[:-1])
    for end in (3, 4, 11):
        with pytest.raises(ValueError, match=r"too short|multiple"):
            stamps_of([message, message[:end], message])


def test_stamps_of_many_messages_are_those_of_each() -> None:
    messages = [stamped("<", sec, nanosec) for sec, nanosec in ((0, 0), (-1, 5), (2**31 - 1, 999_999_999))]
    assert stamps_of(messages).tolist() == [serialized_nanoseconds(message) for message in messages]
    assert stamps_of([]).size == 0


def serialize(message: Any) -> bytes:
    """Serialize the encoding, an array with its length, a number, and another array."""
    first, number, second = message.first, message.number, message.second
    layout = f"=4B I4x{len(first)}d d I4x{len(second)}d"
    return struct.pack(layout, 0, 1, 0, 0, len(first), *first, number, len(second), *second)


@pytest.mark.parametrize("kind", [np.array, lambda numbers: array("d", numbers)])
def test_numbers_are_found_where_they_stand(kind: Any) -> None:
    message = SimpleNamespace(first=kind([1.0, 2.0]), number=0.5, second=kind([3.0]))
    data, places = places_of_numbers(message, ["second", "first", "number"], serialize)
    assert places == {"first": 12, "number": 28, "second": 44}
    for name, place in places.items():
        numbers = np.atleast_1d(getattr(message, name))
        assert data[place : place + numbers.nbytes] == numbers.tobytes()


def test_an_empty_array_has_no_place() -> None:
    message = SimpleNamespace(first=array("d"), number=0.5, second=array("d", [3.0]))
    assert places_of_numbers(message, ["first", "number", "second"], serialize)[1] == {"number": 12, "second": 28}
    assert places_of_numbers(message, [], serialize)[1] == {}


def test_numbers_that_are_not_in_the_message_are_named() -> None:
    message = SimpleNamespace(first=array("d", [1.0]), number=0.5, second=array("d"), other=1.0)
    with pytest.raises(ValueError, match="marks of other"):
        places_of_numbers(message, ["number", "other"], serialize)


def test_numbers_of_messages_that_are_alike_are_read_at_once() -> None:
    def message(first: list[float], number: float, second: list[float]) -> Any:
        return SimpleNamespace(first=array("d", first), number=number, second=array("d", second))

    known, *others = [serialize(message([k, k + 1.0], 0.5 * k, [3.0])) for k in range(3)]
    other = serialize(message([1.0], 0.5, [2.0, 3.0]))
    names = ["first", "number", "second"]
    shared, places = layout_of(known + b"rest", message([0.0, 1.0], 0.0, [3.0]), names, serialize)
    table = NumberTable(known, shared[: len(known)], [places["number"], places["first"] + 8])
    assert len(other) == len(known)
    alike, numbers = table.read([known, other, *others])
    assert alike.tolist() == [True, False, True, True]
    assert numbers.tolist() == [[0.0, 1.0], [0.5, 2.0], [1.0, 3.0]]
    assert NumberTable(known, shared[: len(known)], []).read(others)[1].shape == (2, 0)
    for differs in (known[:-1], b"\0\0" + known[2:]):
        with pytest.raises(ValueError, match="in another way"):
            layout_of(differs, message([0.0, 1.0], 0.0, [3.0]), names, serialize)


@pytest.mark.parametrize("frame", [b"\0", b"world\0", b""])
def test_the_end_of_an_empty_message_is_known_whatever_follows(frame: bytes) -> None:
    header = stamped("<", 1, 2) + struct.pack("<I", len(frame)) + frame + bytes(-len(frame) % 4)
    message = header + bytes(12)
    for rest in (b"", b"\xff" * 7):
        assert end_of_empty(message + rest, 3) == len(message)
    assert end_of_empty(message, 4) == 0
    assert end_of_empty(header + struct.pack("<III", 0, 1, 0), 3) == 0
    assert end_of_empty(message[:13], 3) == 0
    assert end_of_empty(stamped(">", 1, 2) + message[12:], 3) == 0


@pytest.mark.parametrize("length", [12, 16, 17, 100])
def test_memory_for_a_message_has_its_numbers_at_whole_words(length: int) -> None:
    words = aligned(length)
    assert words.size % 8 == 0
    assert words.ctypes.data % 8 == 0
    assert words[LEAD:].size >= length
    assert (LEAD + 4) % 8 == 0
