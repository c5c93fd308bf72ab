"""Fast serialization for topics with one message per sample.

rclpy takes longer to serialize and deserialize a Python message than the rest of a tick takes. But the messages of a
topic differ only in their stamp and their numbers. Therefore a message is serialized once, and afterwards only the
numbers are overwritten in place. rclpy deserializes a received message once, and again only if anything besides its
stamp and numbers has changed.

Padding counts too: rclpy does not initialise it, other than `pidtsm_ros.serialization`. Messages whose padding changes
are read the slow way, never wrongly.
"""

import struct
from array import array
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.parameters.joints import ABSURD, JointOrder, MessageError
from pidtsm_core.timing import NANOSECONDS
from pidtsm_ros.cdr import DOUBLE, LEAD, STAMP, STAMP_BEGIN, aligned, layout_of, places_of_numbers
from pidtsm_ros.serialization import serialize, serialize_checked

_STAMPED = ("std_msgs/Header", "builtin_interfaces/Time")
"""Types that begin with a stamp, if they are the first field."""


def deserialize(data: bytes, message_type: type) -> Any:
    """Deserialize a message.

    Raises:
        MessageError: the bytes are not a message of this type.
    """
    try:
        return deserialize_message(data, message_type)
    except Exception as error:  # rclpy's own errors, and Python's if a text is not UTF-8.
        raise MessageError(f"cannot be deserialized: {' '.join(str(error).split())}") from None


def _find_code(message: Any, name: str) -> int:
    """Offset of a uint8 field: the byte that changes with it."""
    values = (0, 255)
    versions = []
    for value in values:
        setattr(message, name, value)
        versions.append(serialize(message))
    setattr(message, name, 0)
    places = [place for place, column in enumerate(zip(*versions, strict=True)) if column == values]
    if len(places) != 1:
        raise ValueError(f"the message does not contain {name} exactly once")
    return places[0]


class OutgoingMessage:
    """A message that is serialized once; its stamp, if any, and its numbers are then overwritten in place.

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
        """Serialize the message; the given fields start at 0.

        Args:
            message: provides everything except the numbers. A stamp, if any, is its first field, either alone or in a
                std_msgs/Header.
            arrays: float64[] fields to fill, consecutive in the message and in its order.
            scalars: float64 fields, likewise; see `set_scalars`.
            joints: length of each array.
            codes: uint8 fields; see `set_codes`.

        Raises:
            ValueError: the message does not contain the fields in this way.
        """
        for name in arrays:
            setattr(message, name, array("d", bytes(DOUBLE * joints)))
        data, places = places_of_numbers(message, [*arrays, *scalars], serialize_checked)
        self._stamped = next(iter(message.get_fields_and_field_types().values())) in _STAMPED
        self._buffer = aligned(len(data))[LEAD : LEAD + len(data)]
        self._buffer[:] = np.frombuffer(data, np.uint8)
        self._memory = self._buffer.data
        self.arrays = self._rows([places[name] for name in arrays], joints)
        self.arrays[:] = 0.0
        if any(places[name] != places[scalars[0]] + DOUBLE * i for i, name in enumerate(scalars)):
            raise ValueError("the scalars are not consecutive in the message")
        self._scalars = struct.Struct(f"={len(scalars)}d")
        self._scalars_place = places[scalars[0]] if scalars else 0
        self.set_scalars(*[0.0] * len(scalars))
        self._codes = [_find_code(message, name) for name in codes]

    def _rows(self, places: Sequence[int], width: int) -> Array:
        """Rows of numbers at these offsets of the buffer as one array, so that one assignment fills them."""
        if not places:
            return np.zeros((0, width))
        strides = set(np.diff(places).tolist()) or {DOUBLE * width}
        if len(strides) > 1:
            raise ValueError("the arrays are not consecutive in the message")
        return np.ndarray((len(places), width), np.float64, self._buffer.data, places[0], (strides.pop(), DOUBLE))

    def set_scalars(self, *values: float) -> None:
        """Write the float64 fields, in their order."""
        self._scalars.pack_into(self._memory, self._scalars_place, *values)

    def set_codes(self, *values: int) -> None:
        """Write the uint8 fields, in their order."""
        for place, value in zip(self._codes, values, strict=True):
            self._memory[place] = value

    def to_bytes(self, stamp: int) -> bytes:
        """Serialized message, ready to publish.

        Args:
            stamp: ns; ignored if the message has no stamp.
        """
        if self._stamped:
            STAMP.pack_into(self._memory, STAMP_BEGIN, *divmod(stamp, NANOSECONDS))
        return self._buffer.tobytes()


@njit
def _take(
    words: NDArray[np.int64],
    layout: NDArray[np.int64],
    numbers: Array,
    wanted: NDArray[np.int64],
    target: Array,
) -> bool:
    """Copy the wanted numbers if the rest of the message has not changed and none of them is absurd.

    Compiled, since pure Python takes twice as long, which would delay the command.

    Args:
        words: the message as integers, shape (words,).
        layout: a message that was read before, and a mask of the bits that must not change, shape (2, words).
        numbers: the same message as floats, shape (words,).
        wanted: indices of the numbers in `numbers`, shape (fields, joints); negative: the message has none, take 0.
        target: result, shape (fields, joints).

    Returns:
        Whether they were copied.
    """
    for i in range(words.size):
        if (words[i] ^ layout[0, i]) & layout[1, i]:
            return False
    for i in range(wanted.shape[0]):
        for j in range(wanted.shape[1]):
            if wanted[i, j] >= 0 and not -ABSURD < numbers[wanted[i, j]] < ABSURD:
                return False
    for i in range(wanted.shape[0]):
        for j in range(wanted.shape[1]):
            target[i, j] = numbers[wanted[i, j]] if wanted[i, j] >= 0 else 0.0
    return True


class IncomingMessages:
    """Reads per-joint numbers from the serialized messages of one topic into the node's joint order.

    The messages begin with a std_msgs/Header and have a field ``name``.
    """

    def __init__(
        self,
        message_type: type,
        fields: Sequence[str],
        joints: Sequence[str],
        optional: Sequence[str] = (),
        others: bool = False,
    ) -> None:
        """Compile the reader and store the expected layout.

        Args:
            message_type: type of the messages.
            fields: float64[] fields to read.
            joints: joint names of the node, in its order.
            optional: those of the fields that may be empty, which means zeros.
            others: whether messages may have more joints, which are ignored.
        """
        self._type = message_type
        self._fields, self._optional = list(fields), optional
        self._order = JointOrder(joints, others)
        self._values = np.zeros((len(fields), len(joints)))
        self._length = -1  # of the layout seen last; see `_learn`
        numbers = {name: [0.0] * len(joints) for name in fields}
        for _ in range(2):
            self.read(serialize(message_type(name=list(joints), **numbers)), np.zeros_like(self._values))

    def read(self, data: bytes, target: Array) -> None:
        """Copy the fields of a serialized message to `target`, shape (fields, joints), contiguous.

        Raises:
            MessageError: the names do not match, an array has the wrong length, or a value is not finite or is absurd.
        """
        if len(data) == self._length:
            self._memory[:] = data
            if _take(self._words, self._layout, self._numbers, self._wanted, target):
                return
        self._read_slowly(data, target)

    def _read_slowly(self, data: bytes, target: Array) -> None:
        message = deserialize(data, self._type)
        for row, name in zip(self._values, self._fields, strict=True):
            values = getattr(message, name)
            row[:] = 0.0
            if len(values) or name not in self._optional:
                self._order.read(message.name, values, name, row)
        target[:] = self._values
        self._learn(data, message)

    def _learn(self, data: bytes, message: Any) -> None:
        """Store where the numbers of such a message are, so that `_take` can read the next ones."""
        names = [name for name, kind in message.get_fields_and_field_types().items() if kind == "sequence<double>"]
        try:
            shared, places = layout_of(data, message, names, serialize)
        except ValueError:
            return  # Serialized differently than here: rclpy deserializes every such message.
        buffer, mask = aligned(len(data)), aligned(len(data))
        buffer[LEAD : LEAD + len(data)] = np.frombuffer(data, np.uint8)
        mask[LEAD : LEAD + len(data)][shared] = 255
        order = self._order.match(message.name)
        self._words, self._numbers = buffer.view(np.int64), buffer.view(np.float64)
        self._layout = np.array([self._words, mask.view(np.int64)])
        none = np.full(order.size, -1)
        wanted = [(LEAD + places[name]) // DOUBLE + order if name in places else none for name in self._fields]
        self._wanted = np.array(wanted, dtype=np.int64)
        self._memory = buffer.data[LEAD : LEAD + len(data)]
        self._length = len(data)
