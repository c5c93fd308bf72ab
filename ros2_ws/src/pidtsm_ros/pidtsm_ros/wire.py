"""Messages as the bytes that travel, for topics that carry one a sample.

Turning a Python message into bytes and back takes rclpy longer than the rest of a tick. But the messages of a
topic differ in nothing but their stamp and their numbers. So a message is serialized once, by rclpy, and from then
on only its numbers are written where they stand; and a message that is received is taken apart by rclpy once, and
again only when something besides its numbers is not as it was.

Padding counts as part of what is as it was: a publisher whose padding changes (rclpy leaves in it what the memory
held) is read by the long way, never wrongly.

Where the numbers stand is not computed but found: a message full of marks is serialized, and the marks are looked for.
"""

import math
import struct
from array import array
from collections.abc import Sequence
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from pidtsm_core.parameters import Array
from pidtsm_core.timing import NANOSECONDS
from pidtsm_ros.joints import ABSURD, JointOrder, MessageError
from pidtsm_ros.stamps import STAMP_END

_STAMP = struct.Struct("=iI")
_DOUBLE = 8  # bytes
_ENCODING = 2  # The first two bytes of a CDR message say how it is encoded; nobody reads the next two.


def _marks(count: int) -> Array:
    """Numbers that occur nowhere else in a message."""
    return np.arange(1, count + 1, dtype=np.float64) * np.float64(-math.pi * 1e-200)


def _find(data: bytes, numbers: Array) -> int:
    """Where in a message these numbers stand, one after the other."""
    pattern = numbers.tobytes()
    if data.count(pattern) != 1:
        raise ValueError("the message does not hold its marks exactly once")
    return data.index(pattern)


class OutgoingMessage:
    """A message that was serialized once, and whose stamp and numbers are written in place.

    Attributes:
        arrays: numbers of the float64[] fields, shape (fields, joints).
        scalars: numbers of the float64 fields, shape (fields,).
    """

    def __init__(self, message: Any, arrays: Sequence[str] = (), scalars: Sequence[str] = (), joints: int = 0) -> None:
        """Serialize it.

        Args:
            message: begins with a stamp, alone or in a std_msgs/Header; all that is not a number is taken from it.
            arrays: float64[] fields to be filled, in the order of the message, one after the other in it.
            scalars: likewise of float64 fields.
            joints: length of each array.
        """
        marks = _marks(len(arrays) * joints + len(scalars))
        table, row = np.split(marks, [len(arrays) * joints])
        table = table.reshape(len(arrays), joints)
        for name, numbers in zip(arrays, table, strict=True):
            setattr(message, name, array("d", numbers))
        for name, number in zip(scalars, row, strict=True):
            setattr(message, name, float(number))
        data = serialize_message(message)
        # So that the numbers, which are aligned to what follows the first four bytes, are aligned in memory.
        self._buffer = np.zeros(len(data) + 4, np.uint8)[4:]
        self._buffer[:] = np.frombuffer(data, np.uint8)
        self._memory = self._buffer.data
        self.arrays = self._view([_find(data, numbers) for numbers in table], joints)
        self.scalars = self._view([_find(data, row[i : i + 1]) for i in range(row.size)], 1)[:, 0]
        self.arrays[:] = 0.0
        self.scalars[:] = 0.0

    def _view(self, places: Sequence[int], width: int) -> Array:
        """Rows of numbers at these places of the buffer as one array, so that one assignment fills them."""
        if not places:
            return np.zeros((0, width))
        strides = set(np.diff(places).tolist()) or {_DOUBLE * width}
        if len(strides) > 1:
            raise ValueError("the fields do not stand one after the other in the message")
        return np.ndarray((len(places), width), np.float64, self._buffer.data, places[0], (strides.pop(), _DOUBLE))

    def to_bytes(self, stamp: int) -> bytes:
        """The message with this stamp, in ns, ready to be published."""
        _STAMP.pack_into(self._memory, STAMP_END - _STAMP.size, *divmod(stamp, NANOSECONDS))
        return self._buffer.tobytes()


class IncomingMessages:
    """Reads per-joint numbers from the serialized messages of one topic, in the order of one's own joints.

    The messages of a topic begin with a std_msgs/Header and have a field ``name``.
    """

    def __init__(self, message_type: type, fields: Sequence[str], joints: Sequence[str]) -> None:
        """What to read.

        Args:
            message_type: type of the messages.
            fields: float64[] fields to be read.
            joints: own joint names.
        """
        self._type = message_type
        self._fields = list(fields)
        self._order = JointOrder(joints)
        self._values = np.zeros((len(fields), len(joints)))
        # Of the last layout met: length of the message, how to unpack it, the parts that must be as they were,
        # and for each of the numbers wanted its place among what was unpacked.
        self._length = -1
        self._unpack = struct.Struct("").unpack
        self._store = struct.Struct(f"={len(fields) * len(joints)}d").pack_into
        self._fixed: list[tuple[int, bytes]] = []
        self._wanted: list[int] = []

    def read(self, data: bytes, target: Array) -> None:
        """Copy the fields to `target`, shape (fields, joints), contiguous.

        Raises:
            MessageError: names that do not match, an array of another length, or a value that is not finite, or absurd.
        """
        if len(data) == self._length:
            parts = self._unpack(data)
            for place, expected in self._fixed:
                if parts[place] != expected:
                    break
            else:
                numbers = [parts[place] for place in self._wanted]
                for value in numbers:
                    if not -ABSURD < value < ABSURD:
                        break  # The way below says what is wrong.
                else:
                    self._store(target.data, 0, *numbers)
                    return
        self._read_slowly(data, target)

    def _read_slowly(self, data: bytes, target: Array) -> None:
        try:
            message = deserialize_message(data, self._type)
        except Exception as error:
            raise MessageError(f"cannot be deserialized: {error}") from None
        for row, name in zip(self._values, self._fields, strict=True):
            self._order.read(message.name, getattr(message, name), name, row)
        target[:] = self._values
        self._learn(data, message)

    def _learn(self, data: bytes, message: Any) -> None:
        """Remember where the numbers of such a message stand."""
        names = [name for name, kind in message.get_fields_and_field_types().items() if kind == "sequence<double>"]
        lengths = [len(getattr(message, name)) for name in names]
        marks = np.split(_marks(sum(lengths)), np.cumsum(lengths)[:-1])
        for name, numbers in zip(names, marks, strict=True):
            setattr(message, name, array("d", numbers))
        marked = serialize_message(message)
        if len(marked) != len(data) or marked[:_ENCODING] != data[:_ENCODING]:
            return  # Serialized in another way than ours: always taken apart by rclpy.
        form, end, parts = f"={_ENCODING}s2x{_STAMP.size}x", STAMP_END, 1
        fixed, first = [0], {}
        for name, numbers in zip(names, marks, strict=True):
            if not numbers.size:
                continue
            place = _find(marked, numbers)
            form += f"{place - end}s{numbers.size}d"
            fixed.append(parts)
            first[name] = parts + 1
            parts += 1 + numbers.size
            end = place + _DOUBLE * numbers.size
        form += f"{len(data) - end}s"
        fixed.append(parts)
        self._unpack = struct.Struct(form).unpack
        found = self._unpack(data)
        self._fixed = [(place, found[place]) for place in fixed]
        self._wanted = [first[name] + int(j) for name in self._fields for j in self._order.match(message.name)]
        self._length = len(data)
