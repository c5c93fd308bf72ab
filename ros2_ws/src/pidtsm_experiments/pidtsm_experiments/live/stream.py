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
from pidtsm_ros.cdr import DOUBLE, STAMP_END, places_of_numbers, stamps_of
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
        self._head = b""
        self._places: NDArray[np.intp] = np.zeros(0, dtype=np.intp)

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
        self._learn(messages[-1], newest)
        alike = [data for data in messages if len(data) == len(messages[-1]) and self._begins_alike(data)]
        table = np.frombuffer(b"".join(alike), np.uint8).reshape(len(alike), -1)
        values = table.take(self._places, axis=1).view("<f8").reshape(len(alike), len(_FIELDS), joints)
        finite = np.isfinite(values).all(axis=(1, 2))
        if not finite.any():
            return None
        return Batch(stamps_of(alike)[finite], values[finite], newest)

    def _begins_alike(self, data: bytes) -> bool:
        return data[STAMP_END : STAMP_END + len(self._head)] == self._head

    def _learn(self, data: bytes, message: ControllerState) -> None:
        """Find out where the numbers are, if the joints are not those of the last message."""
        if self._head and self._begins_alike(data):
            return
        # A copy, since it is overwritten.
        copied = deserialize(data, ControllerState)
        _, places = places_of_numbers(copied, _FIELDS, serialize_message)
        starts = [places[field] + DOUBLE * j for field in _FIELDS for j in range(len(message.name))]
        self._places = np.add.outer(starts, np.arange(DOUBLE)).ravel()
        self._head = data[STAMP_END : min(starts)]

    @property
    def publishers(self) -> int:
        """Number of publishers of the topic."""
        return int(self._subscription.get_publisher_count())


def _never_called(message: bytes) -> None:
    """The node has no executor."""


def by_name(names: Sequence[str], values: Sequence[float], wanted: Sequence[str]) -> Array:
    """Values in another order of joints, shape (wanted,); nan for a joint that has none."""
    found = dict(zip(names, values, strict=False))
    return np.array([found.get(joint, np.nan) for joint in wanted])
