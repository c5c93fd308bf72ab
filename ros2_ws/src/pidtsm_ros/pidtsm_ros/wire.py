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
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message, serialize_message

from pidtsm_core.compiled import njit
from pidtsm_core.joints import ABSURD, JointOrder, MessageError
from pidtsm_core.parameters import Array
from pidtsm_core.timing import NANOSECONDS
from pidtsm_ros.stamps import STAMP_END

_STAMP = struct.Struct("=iI")
_STAMPS = ("std_msgs/Header", "builtin_interfaces/Time")
"""Types of a first field that begins with a stamp."""
_DOUBLE = 8  # bytes
_START = 4  # Place of a message among whole words.
_ENCODING = 2  # The first two bytes of a CDR message say how it is encoded; nobody reads the next two.


def deserialize(data: bytes, message_type: type) -> Any:
    """The message.

    Raises:
        MessageError: the bytes are none of this type.
    """
    try:
        return deserialize_message(data, message_type)
    except Exception as error:  # rclpy's own, and Python's where a text is not UTF-8.
        raise MessageError(f"cannot be deserialized: {' '.join(str(error).split())}") from None


def _marks(count: int) -> Array:
    """Numbers that occur nowhere else in a message."""
    return np.arange(1, count + 1, dtype=np.float64) * np.float64(-math.pi * 1e-200)


def _find(data: bytes, numbers: Array) -> int:
    """Where in a message these numbers stand, one after the other."""
    pattern = numbers.tobytes()
    if data.count(pattern) != 1:
        raise ValueError("the message does not hold its marks exactly once")
    return data.index(pattern)


def _find_code(message: Any, name: str) -> int:
    """Where the uint8 field stands: what changes with it."""
    places: set[int] | None = None
    # What rclpy leaves in the padding may look the same once, but not every time.
    for _ in range(3):
        versions = []
        for value in (0, 255):
            setattr(message, name, value)
            versions.append(serialize_message(message))
        found = {i for i, pair in enumerate(zip(*versions, strict=True)) if pair == (0, 255)}
        places = found if places is None else places & found
    setattr(message, name, 0)
    if not places or len(places) != 1:
        raise ValueError(f"the message does not hold {name} exactly once")
    return places.pop()


class OutgoingMessage:
    """A message that was serialized once, and whose stamp, where it has one, and numbers are written in place.

    Attributes:
        arrays: numbers of the float64[] fields, shape (fields, joints).
    """

    def __init__(
        self,
        message: Any,
        arrays: Sequence[str] = (),
        scalars: Sequence[str] = (),
        joints: int = 0,
        codes: Sequence[str] = (),
    ) -> None:
        """Serialize it.

        Args:
            message: all that is not a number is taken from it. Where it has a stamp it begins with it, alone or in a
                std_msgs/Header.
            arrays: float64[] fields to be filled, in the order of the message, one after the other in it.
            scalars: likewise of float64 fields; see `set_scalars`.
            joints: length of each array.
            codes: uint8 fields; see `set_codes`.
        """
        marks = _marks(len(arrays) * joints + len(scalars))
        table, row = np.split(marks, [len(arrays) * joints])
        table = table.reshape(len(arrays), joints)
        for name, numbers in zip(arrays, table, strict=True):
            setattr(message, name, array("d", numbers))
        for name, number in zip(scalars, row, strict=True):
            setattr(message, name, float(number))
        data = serialize_message(message)
        self._stamped = next(iter(message.get_fields_and_field_types().values())) in _STAMPS
        self._buffer = _aligned(len(data))[_START : _START + len(data)]
        self._buffer[:] = np.frombuffer(data, np.uint8)
        self._memory = self._buffer.data
        self.arrays = self._view([_find(data, numbers) for numbers in table], joints)
        self._scalars = struct.Struct(f"={row.size}d")
        self._scalars_place = _find(data, row) if row.size else 0
        self.arrays[:] = 0.0
        self.set_scalars(*[0.0] * row.size)
        self._codes = [_find_code(message, name) for name in codes]

    def _view(self, places: Sequence[int], width: int) -> Array:
        """Rows of numbers at these places of the buffer as one array, so that one assignment fills them."""
        if not places:
            return np.zeros((0, width))
        strides = set(np.diff(places).tolist()) or {_DOUBLE * width}
        if len(strides) > 1:
            raise ValueError("the fields do not stand one after the other in the message")
        return np.ndarray((len(places), width), np.float64, self._buffer.data, places[0], (strides.pop(), _DOUBLE))

    def set_scalars(self, *values: float) -> None:
        """Write the float64 fields, in their order."""
        self._scalars.pack_into(self._memory, self._scalars_place, *values)

    def set_codes(self, *values: int) -> None:
        """Write the uint8 fields, in their order."""
        for place, value in zip(self._codes, values, strict=True):
            self._memory[place] = value

    def to_bytes(self, stamp: int) -> bytes:
        """The message with this stamp, in ns, ready to be published; one without a stamp stays without."""
        if self._stamped:
            _STAMP.pack_into(self._memory, STAMP_END - _STAMP.size, *divmod(stamp, NANOSECONDS))
        return self._buffer.tobytes()


def _aligned(length: int) -> NDArray[np.uint8]:
    """Zeros for a message of this length that begins at `_START`, in whole words.

    CDR aligns numbers to what follows the first four bytes of a message.
    """
    return np.zeros(-(-(_START + length) // _DOUBLE) * _DOUBLE, np.uint8)


@njit
def _take(
    words: NDArray[np.int64],
    layout: NDArray[np.int64],
    numbers: Array,
    wanted: NDArray[np.int64],
    target: Array,
) -> bool:
    """Copy the numbers wanted, if the rest of the message is as it was and none of them is absurd.

    Compiled, since Python's way takes twice the time while a sample waits for its answer.

    Args:
        words: the message.
        layout: a message that was read before, and a mask of what must be the same, shape (2, words).
        numbers: the message once more.
        wanted: places of the numbers, shape of `target`.
        target: result.
    """
    for i in range(words.size):
        if (words[i] ^ layout[0, i]) & layout[1, i]:
            return False
    for i in range(wanted.shape[0]):
        for j in range(wanted.shape[1]):
            if not -ABSURD < numbers[wanted[i, j]] < ABSURD:
                return False
    for i in range(wanted.shape[0]):
        for j in range(wanted.shape[1]):
            target[i, j] = numbers[wanted[i, j]]
    return True


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
        # Of the last layout met: a place for a message, as bytes, words and numbers; see `_take`.
        self._length = -1
        # The layout to be expected, and compiled before the loop.
        numbers = {name: [0.0] * len(joints) for name in fields}
        for _ in range(2):
            self.read(serialize_message(message_type(name=list(joints), **numbers)), np.zeros_like(self._values))

    def read(self, data: bytes, target: Array) -> None:
        """Copy the fields to `target`, shape (fields, joints), contiguous.

        Raises:
            MessageError: names that do not match, an array of another length, or a value that is not finite, or absurd.
        """
        if len(data) == self._length:
            self._memory[:] = data
            if _take(self._words, self._layout, self._numbers, self._wanted, target):
                return
        self._read_slowly(data, target)

    def _read_slowly(self, data: bytes, target: Array) -> None:
        message = deserialize(data, self._type)
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
        buffer, changing = _aligned(len(data)), _aligned(len(data))
        start = _START
        buffer[start : start + len(data)] = np.frombuffer(data, np.uint8)
        changing[start + _ENCODING : start + STAMP_END] = 255
        first = {}
        for name, numbers in zip(names, marks, strict=True):
            if numbers.size:
                place = start + _find(marked, numbers)
                changing[place : place + _DOUBLE * numbers.size] = 255
                first[name] = place // _DOUBLE
        order = self._order.match(message.name)
        self._words, self._numbers = buffer.view(np.int64), buffer.view(np.float64)
        self._layout = np.array([self._words, ~changing.view(np.int64)])
        self._wanted = np.array([first[name] + order for name in self._fields], dtype=np.int64)
        self._memory = buffer.data[start : start + len(data)]
        self._length = len(data)
