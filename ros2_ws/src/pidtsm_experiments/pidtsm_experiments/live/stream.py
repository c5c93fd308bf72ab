"""The states that a controller publishes, taken in batches: every sample, at a fraction of the cost of callbacks."""

from collections.abc import Sequence
from copy import copy
from typing import NamedTuple

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
    values: Array  # shape (samples, len(Signal), joints)
    newest: ControllerState


class StateStream:
    """A subscription to ``controller/state`` of a node that no executor spins.

    It is the only topic of the loop that a page reads while the controller runs: the controller publishes it after its
    command, so nothing in the loop waits for it.
    """

    def __init__(self, node: Node) -> None:
        qos = copy(READER)
        qos.depth = _DEPTH
        self._subscription = node.create_subscription(ControllerState, "controller/state", _never_called, qos, raw=True)
        self._table: NumberTable | None = None

    def take(self) -> Batch | None:
        """All messages that have arrived, and are like the last one; None if there is none."""
        messages = []
        while (taken := self._subscription.handle.take_message(ControllerState, True)) is not None:
            messages.append(bytes(taken[0]))
        if not messages:
            return None
        try:
            newest = deserialize(messages[-1], ControllerState)
        except MessageError:
            return None
        joints = len(newest.name)
        if any(len(getattr(newest, field)) != joints for field in _FIELDS) or not joints:
            return None
        same = [data for data in messages if len(data) == len(messages[-1])]
        if self._table is None or self._table.length != len(same[-1]):
            self._table = _table_like(same[-1], joints)
        alike, numbers = self._table.read(same)
        if not alike[-1]:  # Other joints.
            self._table = _table_like(same[-1], joints)
            alike, numbers = self._table.read(same)
        values = numbers.reshape(-1, len(_FIELDS), joints)
        finite = np.isfinite(values).all(axis=(1, 2))
        if not finite.any():
            return None
        return Batch(stamps_of(same)[alike][finite], values[finite], newest)


def _table_like(data: bytes, joints: int) -> NumberTable:
    """Reads the fields of states with the joints of this one, whatever mode and fault they have."""
    shared, places = layout_of(data, deserialize(data, ControllerState), _FIELDS, serialize_message)
    wanted = [places[field] + DOUBLE * j for field in _FIELDS for j in range(joints)]
    shared[max(wanted) :] = False
    return NumberTable(data, shared, wanted)


def _never_called(message: bytes) -> None:
    """The node has no executor."""


def by_name(names: Sequence[str], values: Sequence[float], wanted: Sequence[str]) -> Array:
    """Values in another order of joints, shape (wanted,); nan for a joint that has none."""
    found = dict(zip(names, values, strict=False))
    return np.array([found.get(joint, np.nan) for joint in wanted])
