"""An MCAP file with messages of ROS 2, as rosbag2 writes it."""

from collections.abc import Sequence
from typing import Any, BinaryIO

import yaml
from mcap.writer import Writer
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinitionFormat,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.typesys.store import Typestore

from pidtsm_experiments.bags.message_types import typestore

_FOREVER = QosTime(9223372036, 854775807)
"""The longest duration of DDS, which means none."""
_FORMATS = {MessageDefinitionFormat.MSG: "ros2msg", MessageDefinitionFormat.IDL: "ros2idl"}


def quality(depth: int, kept: bool = False) -> Qos:
    """Quality of service of a reliable publisher.

    Args:
        depth: length of its queue.
        kept: whether subscribers that join later get its last messages (transient local).
    """
    durability = QosDurability.TRANSIENT_LOCAL if kept else QosDurability.VOLATILE
    history, reliability, alive = QosHistory.KEEP_LAST, QosReliability.RELIABLE, QosLiveliness.AUTOMATIC
    return Qos(history, depth, reliability, durability, _FOREVER, _FOREVER, alive, _FOREVER, False)


class McapFile:
    """An MCAP file that is being written, compressed, with checksums and an index."""

    def __init__(self, stream: BinaryIO) -> None:
        """Begin the file.

        Args:
            stream: to write to; it must know its position.
        """
        self._writer = Writer(stream)
        self._writer.start("ros2")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def add_record(self, name: str, content: dict[str, str]) -> None:
        """Add a metadata record."""
        self._writer.add_metadata(name, content)

    def add_topic(self, topic: str, kind: str, qualities: Sequence[Qos]) -> None:
        """Add a topic of a standard type.

        Args:
            topic: full name.
            kind: message type.
            qualities: of its publishers.
        """
        self._add(topic, kind, *_definition(typestore(), kind), "cdr", qualities)

    def add_recorded(self, connection: Connection, store: Typestore) -> None:
        """Add a topic of a bag as it was recorded, if there is none of its name yet.

        Args:
            connection: of the bag.
            store: the types of the bag.
        """
        if connection.topic in self._channels:
            return
        about = connection.ext
        assert isinstance(about, ConnectionExtRosbag2)
        form, definition = _FORMATS.get(connection.msgdef.format, ""), connection.msgdef.data
        made = _definition(store, connection.msgtype)
        # rosbags reads the hashes of a folder, and not those of a single file.
        described = (form, definition, connection.digest or made[2]) if form else made
        qualities = about.offered_qos_profiles
        self._add(connection.topic, connection.msgtype, *described, about.serialization_format, qualities)

    def write(self, topic: str, time: int, data: bytes) -> None:
        """Add a message.

        Args:
            topic: of `add_topic` or `add_recorded`.
            time: of its recording, ns.
            data: the serialized message.

        Raises:
            OSError: writing failed.
        """
        self._writer.add_message(self._channels[topic], time, data, time)

    def finish(self) -> None:
        """Write index and end.

        Raises:
            OSError: writing failed.
        """
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _add(
        self, topic: str, kind: str, form: str, definition: str, digest: str, encoding: str, qualities: Sequence[Qos]
    ) -> None:
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, form, definition.encode())
        offered = yaml.safe_dump([_plain(each) for each in qualities], sort_keys=False)
        about = {"offered_qos_profiles": offered, "topic_type_hash": digest}
        self._channels[topic] = self._writer.register_channel(topic, encoding, self._schemas[kind], about)


def _definition(store: Typestore, kind: str) -> tuple[str, str, str]:
    """Format and text of the definition of a type, and its hash (REP 2011)."""
    definition, _ = store.generate_msgdef(kind, ros_version=2)
    return "ros2msg", definition, store.hash_rihs01(kind)


def _plain(quality: Qos) -> dict[str, Any]:
    """A quality of service in the form of version 9 of rosbag2's metadata."""
    values = quality._asdict()
    durations = {name: value._asdict() for name, value in values.items() if isinstance(value, QosTime)}
    names = {name: getattr(value, "name", "").lower() for name, value in values.items()}
    return {name: durations.get(name) or names[name] or value for name, value in values.items()}
