"""Messages as bytes: of exactly their length, and every byte of them written.

`rclpy.serialization.serialize_message` reserves eight bytes too many for an empty sequence of doubles, and returns what
it has reserved. Neither it nor publishing an object writes the padding between fields. Both send memory of the process
to the network, and other implementations refuse messages that are too long. Therefore every message of ours is
serialized here: plain CDR (OMG DDSI-RTPS 2.3, chapter 10) in the byte order of this machine, with zeros as padding.
"""

import struct
import sys
from functools import cache
from typing import Any

from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractSequence,
    AbstractString,
    BasicType,
    NamespacedType,
)

from pidtsm_ros.cdr import STAMP_BEGIN

_HEADER = bytes((0, sys.byteorder == "little", 0, 0))
_FORMATS = {
    "boolean": "?",
    "octet": "c",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float": "f",
    "double": "d",
}


def serialize(message: Any) -> bytes:
    """A message as CDR; equal messages give equal bytes.

    Raises:
        ValueError: the message has a field of a type that no message of ours has, such as a wide string.
    """
    data = bytearray(_HEADER)
    _append_message(data, message)
    return bytes(data)


def serialize_checked(message: Any) -> bytes:
    """As `serialize`, checked against rclpy: it reads the same message from the bytes, and nothing from fewer.

    For what is serialized once, at the start. The message must not contain nan, which equals nothing.

    Raises:
        ValueError: rclpy reads the bytes differently.
    """
    data = serialize(message)
    if _read(data, type(message)) != message or _read(data[:-1], type(message)) is not None:
        raise ValueError(f"rclpy reads {type(message).__name__} differently than pidtsm_ros.serialization writes it")
    return data


class ExactPublisher(Publisher):
    """A publisher that sends exactly the bytes of `serialize`, for ``create_publisher(..., publisher_class=...)``."""

    def publish(self, msg: Any) -> None:
        """Publish a message, or one that is serialized already."""
        super().publish(msg if isinstance(msg, bytes) else serialize(msg))


def _read(data: bytes, message_type: type) -> Any:
    """The message that rclpy reads; None if it refuses the bytes."""
    try:
        return deserialize_message(data, message_type)
    except Exception:  # rclpy's own errors, and Python's if a text is not UTF-8.
        return None


def _append_message(data: bytearray, message: Any) -> None:
    fields = message.get_fields_and_field_types()
    for name, kind in zip(fields, message.SLOT_TYPES, strict=True):
        _append(data, getattr(message, name), kind)
    if not fields:
        data.append(0)  # A structure without members has one unused byte.


def _append(data: bytearray, value: Any, kind: Any) -> None:
    """Append a field of the type `kind`."""
    if isinstance(kind, BasicType):
        _append_numbers(data, (value,), kind)
    elif isinstance(kind, NamespacedType):
        _append_message(data, value)
    elif isinstance(kind, AbstractString):
        text = value.encode() + b"\0"
        _append_length(data, len(text))
        data += text
    elif isinstance(kind, AbstractNestedType):
        if isinstance(kind, AbstractSequence):
            _append_length(data, len(value))
        if isinstance(kind.value_type, BasicType):
            _append_numbers(data, value, kind.value_type)
        else:
            for each in value:
                _append(data, each, kind.value_type)
    else:
        raise ValueError(f"fields of the type {type(kind).__name__} cannot be serialized")


def _append_numbers(data: bytearray, values: Any, kind: BasicType) -> None:
    """Append numbers after their padding; nothing if there are none."""
    if len(values):
        letter, size = _format(kind.typename)
        _pad(data, size)
        data += struct.pack(f"={len(values)}{letter}", *values)


def _append_length(data: bytearray, length: int) -> None:
    _pad(data, 4)
    data += struct.pack("=I", length)


def _pad(data: bytearray, size: int) -> None:
    """Zeros up to a multiple of `size` bytes after the header."""
    data += bytes((STAMP_BEGIN - len(data)) % size)


@cache
def _format(name: str) -> tuple[str, int]:
    """Letter of `struct` and size in bytes of a basic type of IDL."""
    if name not in _FORMATS:
        raise ValueError(f"fields of the type {name} cannot be serialized")
    return _FORMATS[name], struct.calcsize(f"={_FORMATS[name]}")
