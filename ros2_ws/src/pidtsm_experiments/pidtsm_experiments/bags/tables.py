"""The messages of any bag as one table, a row for each joint of each message."""

from array import array
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection, Nodetype
from rosbags.typesys.store import Typestore

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Recording, Stamps
from pidtsm_core.timing import NANOSECONDS
from pidtsm_experiments.bags.columns import BagMessages
from pidtsm_experiments.bags.errors import RecordingError, damaged
from pidtsm_experiments.bags.reader import open_bag
from pidtsm_experiments.bags.recovery import readable
from pidtsm_experiments.bags.topics import WantedTopic

Column: TypeAlias = Array | Stamps | Sequence[str]
Table: TypeAlias = dict[str, Column]
"""Columns of equal lengths by their name; nan stands for a value that does not exist."""
_NAMES = (Nodetype.SEQUENCE, ((Nodetype.BASE, ("string", 0)), 0))
_NUMBERS = (Nodetype.SEQUENCE, ((Nodetype.BASE, ("float64", 0)), 0))
_NUMBER = ((Nodetype.BASE, ("float64", 0)), (Nodetype.BASE, ("uint8", 0)))


def sample_table(recording: Recording) -> Table:
    """A run with one row per sample: ``time`` (s), and the arrays of the recording, as in ``effort.joint2``."""
    columns: Table = {"time": recording.time}
    for name, values in recording.arrays().items():
        for joint, column in zip(recording.joints, values.T, strict=True):
            columns[f"{name}.{joint}"] = column
    return columns


def message_table(path: Path) -> Table:
    """The messages of a bag that have joint names, with one row per message and joint, in the order of the bag.

    Args:
        path: rosbag2 folder (MCAP or SQLite), or one .mcap or .db3 file; a bag that was not finished is read as far as
            possible.

    Returns:
        ``topic``; ``time``, since the earliest stamp, s; ``stamp``, ns; ``joint``; and one column for each field with
        numbers, such as ``position``, with the units of the messages.

    Raises:
        RecordingError: not a bag, a damaged one, or none of its topics has joint names.
    """
    try:
        with readable(path) as bag, closing(open_bag(path, bag)) as reader:
            fields = {c.msgtype: found for c in reader.connections if (found := _fields(reader.typestore, c.msgtype))}
            wanted = [connection for connection in reader.connections if connection.msgtype in fields]
            if not wanted:
                present = sorted({f"{c.topic} ({c.msgtype})" for c in reader.connections})
                raise RecordingError(f"no topic has joint names; there are {', '.join(present)}")
            rows = _Rows(dict.fromkeys(name for found in fields.values() for name in found.all))
            for connection, message in _messages(BagMessages(reader), wanted):
                rows.add(connection.topic, message, fields[connection.msgtype])
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error.__cause__
    except Exception as error:  # Damaged files cause many kinds of exceptions, rosbags' own and Python's.
        raise RecordingError(f"{path}: {damaged('not a whole bag', error)}") from error
    return rows.table()


@dataclass(frozen=True)
class _Fields:
    """Fields of a message with joint names: one number for each joint, and one for all."""

    each: tuple[str, ...]
    common: tuple[str, ...]

    @property
    def all(self) -> tuple[str, ...]:
        return (*self.each, *self.common)


def _fields(store: Typestore, msgtype: str) -> _Fields | None:
    """The fields of a type with a header and a list of names; None: it is another one."""
    known = dict(store.get_msgdef(msgtype).fields)
    if "header" not in known or known.get("name") != _NAMES:
        return None
    each = tuple(name for name, kind in known.items() if kind == _NUMBERS)
    return _Fields(each, tuple(name for name, kind in known.items() if kind in _NUMBER))


def _messages(messages: BagMessages, connections: Sequence[Connection]) -> Iterator[tuple[Connection, Any]]:
    types = {connection.topic: connection for connection in connections}
    for topic, data in messages.serialized(connections):
        connection = types[topic]
        yield connection, messages.parse(data, WantedTopic(topic, connection.msgtype))


class _Rows:
    """The table while it grows."""

    def __init__(self, fields: Sequence[str] | dict[str, None]) -> None:
        self._topics: list[str] = []
        self._joints: list[str] = []
        self._stamps = array("q")
        self._values = {name: array("d") for name in fields}

    def add(self, topic: str, message: Any, fields: _Fields) -> None:
        joints = list(message.name)
        count = len(joints)
        self._topics.extend([topic] * count)
        self._joints.extend(joints)
        stamp = message.header.stamp
        self._stamps.extend([stamp.sec * NANOSECONDS + stamp.nanosec] * count)
        none = [np.nan] * count
        for name, column in self._values.items():
            if name in fields.each and len(values := getattr(message, name)) == count:
                column.extend(values)
            elif name in fields.common:
                column.extend([float(getattr(message, name))] * count)
            else:
                column.extend(none)

    def table(self) -> Table:
        stamps: NDArray[np.int64] = np.array(self._stamps, dtype=np.int64)
        time = (stamps - (stamps.min() if stamps.size else 0)) / NANOSECONDS
        start: Table = {"topic": self._topics, "time": time, "stamp": stamps, "joint": self._joints}
        return start | {name: np.array(column) for name, column in self._values.items()}
