"""Topics of a bag as arrays, decoded in blocks of messages."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, Nodetype

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Codes, Stamps
from pidtsm_core.signals import Status
from pidtsm_experiments.bags.errors import RecordingError, damaged
from pidtsm_experiments.bags.reports import Reported, reported
from pidtsm_experiments.bags.topics import DIAGNOSTICS, MEASURED, REFERENCE, STATE, TRUTH, WantedTopic
from pidtsm_ros.cdr import DOUBLE, ENCODING, STAMP_END, Layout, NumberTable, end_of_empty, layout_of, stamps_of

_FLOAT64 = ((Nodetype.BASE, ("float64", 0)), (Nodetype.SEQUENCE, ((Nodetype.BASE, ("float64", 0)), 0)))
"""Field types float64 and float64[] in the notation of rosbags."""
_SURPLUS = (4, 8, 12)
"""Bytes that `rclpy.serialization.serialize_message` appends to a message with empty sequences."""
_BLOCK = 2048  # messages decoded at once: enough for NumPy, few enough for memory and for mixed layouts


@dataclass(frozen=True)
class Columns:
    """The messages of one topic as arrays.

    Attributes:
        topic: topic of the messages.
        stamps: ns, shape (messages,).
        values: shape (fields, messages, joints), order of the topic's fields; nan where an optional field is empty.
            The memory of fields that are not kept is never written, so the operating system never allocates it.
        scalars: shape (messages,), or (0,) if the topic has no scalar.
        codes: shape (messages, codes), order of the topic's codes.
        filled: whether each message has joints and values, shape (messages,).
        kept: indices of the fields that are kept.
    """

    topic: WantedTopic
    stamps: Stamps
    values: Array
    scalars: Array
    codes: Codes
    filled: NDArray[np.bool_]
    kept: Sequence[int]

    @classmethod
    def blank(cls, topic: WantedTopic, messages: int, joints: int, kept: Sequence[int]) -> "Columns":
        """Zeros for so many messages."""
        return cls(
            topic,
            np.zeros(messages, dtype=np.int64),
            np.zeros((len(topic.fields), messages, joints)),
            np.zeros(messages if topic.scalar else 0),
            np.zeros((messages, len(topic.codes)), dtype=np.uint8),
            np.ones(messages, dtype=np.bool_),
            kept,
        )

    def view(self, start: int, stop: int) -> "Columns":
        """Views of the messages from `start` to before `stop`."""
        return Columns(
            self.topic,
            self.stamps[start:stop],
            self.values[:, start:stop],
            self.scalars[start:stop],
            self.codes[start:stop],
            self.filled[start:stop],
            self.kept,
        )

    def at(self, rows: NDArray[np.intp]) -> "Columns":
        """A copy of the messages at these indices, shape (rows,)."""
        copy = Columns.blank(self.topic, rows.size, self.values.shape[2], self.kept)
        copy.stamps[:] = self.stamps[rows]
        copy.codes[:] = self.codes[rows]
        copy.filled[:] = self.filled[rows]
        for i in self.kept:
            copy.values[i] = self.values[i, rows]
        if self.topic.scalar:
            copy.scalars[:] = self.scalars[rows]
        return copy

    def sorted(self) -> "Columns":
        """The messages sorted by stamp, only the first with each stamp; self if already sorted, else a copy."""
        if (np.diff(self.stamps) > 0).all():
            return self
        return self.at(np.unique(self.stamps, return_index=True)[1])


class BagMessages:
    """Reads the messages of an open bag; its errors name what cannot be read."""

    def __init__(self, reader: AnyReader) -> None:
        self._reader = reader

    def serialized(self, connections: Sequence[Connection]) -> Iterator[tuple[str, bytes]]:
        """Yield topic name and serialized message for every message of `connections`, in the order of the bag.

        Raises:
            RecordingError: the file is damaged.
        """
        try:
            for connection, _, data in self._reader.messages(connections):
                yield connection.topic, data
        except Exception as error:  # Damaged files cause many kinds of exceptions, rosbags' own and Python's.
            raise damaged("the messages cannot be read", error) from error

    def parse(self, data: bytes, topic: WantedTopic) -> Any:
        """Deserialize a message.

        Raises:
            RecordingError: the message is damaged.
        """
        try:
            return self._reader.deserialize(data, topic.msgtype)
        except Exception as error:  # as in serialized
            for surplus in _SURPLUS:
                with suppress(Exception):
                    return self._reader.deserialize(data[:-surplus], topic.msgtype)
            raise damaged(f"a message of {topic.name} cannot be read", error) from error

    def layout(self, data: bytes, message: Any, topic: WantedTopic) -> Layout:
        """Where the numbers of a message are.

        Args:
            data: the serialized message.
            message: the same, deserialized; its numbers are overwritten.
            topic: topic of the message.

        Raises:
            RecordingError: the message is not little-endian CDR.
        """
        store = self._reader.typestore
        names = [name for name, kind in store.get_msgdef(topic.msgtype).fields if kind in _FLOAT64]
        try:
            return layout_of(
                data, message, names, lambda marked: store.serialize_cdr(marked, topic.msgtype, little_endian=True)
            )
        except ValueError:
            raise RecordingError(f"{topic.name} is not little-endian CDR") from None


def read_columns(
    reader: AnyReader,
    connections_of: Mapping[WantedTopic, Sequence[Connection]],
    only: frozenset[str] | None,
    namespace: str,
) -> tuple[tuple[str, ...], dict[WantedTopic, Columns], Reported]:
    """Read the topics of a run.

    Args:
        reader: reader of the bag.
        connections_of: the topics to read.
        only: names of the fields to keep; None: keep all.
        namespace: namespace of the nodes if the topic names omit it, else empty.

    Returns:
        Joint names of the ground truth, or of the joint states if there is none; every topic of samples, sorted by
        stamp, each stamp once; and what the nodes have reported.

    Raises:
        RecordingError: messages are damaged, have no values, or have values that are not finite.
    """
    messages = BagMessages(reader)
    motion = TRUTH if TRUTH in connections_of else MEASURED
    _, first = next(messages.serialized(connections_of[motion]), ("", b""))
    joints = tuple(messages.parse(first, motion).name)
    decoders: dict[WantedTopic, _Decoder] = {}
    decoder_of: dict[str, _Decoder] = {}
    for topic, connections in connections_of.items():
        if topic is not DIAGNOSTICS:
            count = sum(connection.msgcount for connection in connections)
            decoders[topic] = _Decoder(topic, count, joints, only, messages)
            decoder_of.update({connection.topic: decoders[topic] for connection in connections})
    reports = []
    for name, data in messages.serialized([c for connections in connections_of.values() for c in connections]):
        if decoder := decoder_of.get(name):
            decoder.add(data)
        else:
            reports.append(messages.parse(data, DIAGNOSTICS))
    columns = {topic: decoder.finish() for topic, decoder in decoders.items()}
    own = namespace or connections_of[motion][0].topic.removesuffix(motion.name).strip("/")
    return joints, columns, reported(reports, own)


def read_topic(
    reader: AnyReader, topic: WantedTopic, connections: Sequence[Connection], joints: tuple[str, ...] = ()
) -> tuple[tuple[str, ...], Columns]:
    """The joints of a topic, and its messages sorted by stamp, each stamp once.

    Args:
        reader: reader of the bag.
        topic: the topic, of messages with the field ``name``.
        connections: its connections; they have messages.
        joints: the joints to read, in this order; empty: those of the first message.

    Raises:
        RecordingError: see `read_columns`.
    """
    messages = BagMessages(reader)
    if not joints:
        _, first = next(messages.serialized(connections), ("", b""))
        joints = tuple(messages.parse(first, topic).name)
    decoder = _Decoder(topic, sum(connection.msgcount for connection in connections), joints, None, messages)
    for _, data in messages.serialized(connections):
        decoder.add(data)
    return joints, decoder.finish()


class _Decoder:
    """Decodes the messages of one topic in blocks.

    Deserializing messages to objects would take most of the time of reading a bag. But the messages of a topic nearly
    always differ only in their numbers, so the offsets of the numbers in one message are valid for all.
    """

    def __init__(
        self,
        topic: WantedTopic,
        count: int,
        joints: tuple[str, ...],
        only: frozenset[str] | None,
        messages: BagMessages,
    ) -> None:
        self._topic, self._joints, self._messages = topic, joints, messages
        # All fields of the reference are kept, since it may have to be interpolated.
        kept = [i for i, name in enumerate(topic.fields) if only is None or name in only or topic is REFERENCE]
        self._columns = Columns.blank(topic, count, len(joints), kept)
        self._decoded = 0
        self._block: list[bytes] = []

    def add(self, data: bytes) -> None:
        self._block.append(data)
        if len(self._block) == _BLOCK:
            self._decode_block()

    def finish(self) -> Columns:
        """All messages, sorted by stamp, each stamp once."""
        self._decode_block()
        if (missing := self._columns.stamps.size - self._decoded) > 0:
            gap = ValueError("the file has a gap")
            raise damaged(f"{missing} messages of {self._topic.name} cannot be read", gap)
        return self._columns.sorted()

    def _decode_block(self) -> None:
        end = self._decoded + len(self._block)
        columns = self._columns.view(self._decoded, end)
        columns.stamps[:] = stamps_of(self._block)
        if self._topic.fields or self._topic.codes:
            self._decode_numbers(columns)
        self._block, self._decoded = [], end

    def _decode_numbers(self, columns: Columns) -> None:
        block, joints = self._block, len(self._joints)
        lengths = np.array([len(data) for data in block])
        pending = np.arange(len(block))
        while pending.size:
            first = block[pending[0]]
            kind = self._kind(first)
            rows = pending[lengths[pending] == len(first)]
            alike, numbers = kind.table.read([block[row] for row in rows])
            rows = rows[alike]
            pending = np.setdiff1d(pending, rows, assume_unique=True)
            columns.codes[rows] = kind.codes
            columns.filled[rows] = numbers.size > 0
            if not numbers.size:
                continue
            values = numbers[:, : len(kind.fields) * joints].reshape(rows.size, len(kind.fields), joints)
            for i in columns.kept:
                columns.values[i, rows] = values[:, kind.fields.index(i)] if i in kind.fields else np.nan
            if self._topic.scalar:
                columns.scalars[rows] = numbers[:, -1]
        _check_finite(columns)

    def _kind(self, data: bytes) -> "_Kind":
        topic, joints = self._topic, self._joints
        if topic.may_be_empty and (end := end_of_empty(data, 1 + len(topic.fields))):
            shared = np.arange(len(data)) < end
            shared[ENCODING:STAMP_END] = False
            return _Kind(NumberTable(data, shared, ()), (), ())
        message = self._messages.parse(data, topic)
        names = list(message.name)
        missing = [joint for joint in joints if joint not in names]
        if missing or not joints:
            raise RecordingError(f"{topic.name} lacks {', '.join(missing) or 'joint names'}; it has {names}")
        sizes = {name: np.size(getattr(message, name, ())) for name in topic.fields}
        given = tuple(i for i, name in enumerate(topic.fields) if sizes[name] or name not in topic.optional)
        for name in (topic.fields[i] for i in given):
            if sizes[name] != len(names):
                raise RecordingError(f"{topic.name} has {sizes[name]} values of {name} for {len(names)} joints")
        shared, places = self._messages.layout(data, message, topic)
        wanted = [places[topic.fields[i]] + DOUBLE * names.index(joint) for i in given for joint in joints]
        if topic.scalar:
            if topic.scalar not in places:
                raise RecordingError(
                    f"{topic.name} has no {topic.scalar}: recorded with another version of pidtsm_msgs"
                )
            wanted.append(places[topic.scalar])
        return _Kind(NumberTable(data, shared, wanted), given, _codes(message, topic, names, joints))


class _Kind(NamedTuple):
    """Messages that are alike.

    Attributes:
        table: of their numbers, in the order fields x joints, scalar; without columns for messages without values.
        fields: indices of the topic's fields that have values.
        codes: codes of the messages, in the order of the topic's codes.
    """

    table: NumberTable
    fields: Sequence[int]
    codes: Sequence[int]


def _codes(message: Any, topic: WantedTopic, names: Sequence[str], joints: Sequence[str]) -> list[int]:
    """The codes of a message; a joint that caused a fault is counted in the order of the recording's joints."""
    codes = [int(getattr(message, name, 0)) for name in topic.codes]
    if topic is STATE and codes[Status.FAULT_JOINT]:
        caused = names[codes[Status.FAULT_JOINT] - 1 : codes[Status.FAULT_JOINT]]
        codes[Status.FAULT_JOINT] = joints.index(caused[0]) + 1 if caused and caused[0] in joints else 0
    return codes


def _check_finite(columns: Columns) -> None:
    topic = columns.topic
    tables = [columns.values[i] for i in columns.kept if topic.fields[i] not in topic.optional]
    for table in tables + ([columns.scalars[:, None]] if topic.scalar else []):
        finite = np.isfinite(table).all(axis=1)
        if not finite.all():
            stamp = columns.stamps[np.argmin(finite)]
            raise RecordingError(f"{topic.name} has values that are not finite, first at stamp {stamp} ns")
