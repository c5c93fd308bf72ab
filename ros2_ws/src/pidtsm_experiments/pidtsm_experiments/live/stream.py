"""The states that a controller publishes, taken in batches: every sample, at a fraction of the cost of callbacks."""

from collections.abc import Sequence
from copy import copy
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.serialization import serialize_message

from pidtsm_core.arrays import Array
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.signals import Signal
from pidtsm_msgs.msg import ControllerState
from pidtsm_ros.cdr import DOUBLE, NumberTable, layout_of, stamps_of
from pidtsm_ros.qos import READER
from pidtsm_ros.wire import deserialize

_DEPTH = 2000
"""Messages that wait while the page is busy: two seconds."""
_FIELDS = [signal.name.lower() for signal in Signal]


class Batch(NamedTuple):
    """The samples that arrived since the last batch."""

    stamps: NDArray[np.int64]  # shape (samples,), ns
    values: Array  # shape (samples, fields, joints)
    newest: Any  # the last message


class NumberStream:
    """A subscription of a node that no executor spins, to messages with joints and numbers for each of them."""

    def __init__(
        self,
        node: Node,
        kind: type[Any],
        topic: str,
        fields: Sequence[str],
        depth: int = _DEPTH,
        optional: Sequence[str] = (),
    ) -> None:
        """Subscribe.

        Args:
            node: in no executor.
            kind: message type, with a header and names.
            topic: its name.
            fields: every float64 array of the message.
            depth: messages that may wait.
            optional: those of them that may be empty, and are nan then.
        """
        qos = copy(READER)
        qos.depth = depth
        self._kind, self._fields, self._optional = kind, list(fields), optional
        self._subscription = node.create_subscription(kind, topic, _never_called, qos, raw=True)
        self._table: NumberTable | None = None

    def take(self) -> Batch | None:
        """All messages that have arrived, and are like the last one; None if there is none."""
        messages = []
        while (taken := self._subscription.handle.take_message(self._kind, True)) is not None:
            messages.append(bytes(taken[0]))
        if not messages:
            return None
        try:
            newest = deserialize(messages[-1], self._kind)
        except MessageError:
            return None
        joints = len(newest.name)
        fields = [field for field in self._fields if field not in self._optional or len(getattr(newest, field))]
        if any(len(getattr(newest, field)) != joints for field in fields) or not joints:
            return None
        same = [data for data in messages if len(data) == len(messages[-1])]
        if self._table is None or self._table.length != len(same[-1]):
            self._table = self._table_like(same[-1], fields, joints)
        alike, numbers = self._table.read(same)
        if not alike[-1]:  # Other joints.
            self._table = self._table_like(same[-1], fields, joints)
            alike, numbers = self._table.read(same)
        read = numbers.reshape(-1, len(fields), joints)
        finite = np.isfinite(read).all(axis=(1, 2))
        if not finite.any():
            return None
        values = np.full((len(read), len(self._fields), joints), np.nan)
        values[:, [self._fields.index(field) for field in fields]] = read
        return Batch(stamps_of(same)[alike][finite], values[finite], newest)

    def _table_like(self, data: bytes, fields: Sequence[str], joints: int) -> NumberTable:
        """Reads the fields of messages with the joints of this one, whatever follows the numbers."""
        shared, places = layout_of(data, deserialize(data, self._kind), fields, serialize_message)
        wanted = [places[field] + DOUBLE * j for field in fields for j in range(joints)]
        shared[max(wanted) :] = False
        return NumberTable(data, shared, wanted)


class StateStream(NumberStream):
    """A subscription to ``controller/state``, with all of `Signal`.

    It is the only topic of the loop that a page reads while the controller runs: the controller publishes it after its
    command, so nothing in the loop waits for it.
    """

    def __init__(self, node: Node, depth: int = _DEPTH) -> None:
        super().__init__(node, ControllerState, "controller/state", _FIELDS, depth)


def _never_called(message: bytes) -> None:
    """The node has no executor."""


def by_name(names: Sequence[str], values: Sequence[float], wanted: Sequence[str]) -> Array:
    """Values in another order of joints, shape (wanted,); nan for a joint that has none."""
    found = dict(zip(names, values, strict=False))
    return np.array([found.get(joint, np.nan) for joint in wanted])
