"""Writes a rosbag2 bag (MCAP) that stays readable up to its last second, even if the writer is killed."""

import contextlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import CompressionType, Writer

from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.metadata import METADATA_KEY

_LARGEST_CHUNK = 300_000
"""Bytes; each chunk is copied several times before it is written, and the memory is not released afterwards."""
_VERSION = 9
"""Format version of metadata.yaml."""
_ENCODING = "cdr"
_NEVER = 2**63 - 1
"""Starting time of a file without messages, as written by rosbag2, ns."""


def free_space(path: Path) -> int:
    """Free bytes on the disk of `path`, which need not exist yet."""
    return shutil.disk_usage(next(p for p in (path.absolute(), *path.absolute().parents) if p.exists())).free


class BagWriter:
    """A bag of one or more files, ``BAG/BAG_0.mcap``, ``BAG/BAG_1.mcap``, ..., and ``BAG/metadata.yaml``.

    Messages are collected in memory until `flush` passes them to the operating system as one complete chunk; from then
    on they survive the end of this process. `close` writes ``metadata.yaml``: a bag without it was not finished, and is
    read by `pidtsm_experiments.bags.recovery`.
    """

    def __init__(self, folder: Path, metadata: str, max_size: int, max_duration: float) -> None:
        """Create the folder and its first file.

        Args:
            folder: folder of the bag; it must not exist.
            metadata: text stored in ``metadata.yaml`` and at the beginning of each file.
            max_size: bytes after which a new file is started; 0: never.
            max_duration: s after which a new file is started; 0: never.

        Raises:
            OSError: the folder exists or cannot be written.
        """
        folder.mkdir(parents=True)
        self._folder = folder
        self._custom_data = {METADATA_KEY: metadata} if metadata else {}
        self._max_size, self._max_duration = max_size or float("inf"), 1e9 * max_duration or float("inf")
        self._topics: list[_Topic] = []
        self._finished: list[_Content] = []
        self._file: _File | None = self._begin_file()

    def add_topic(self, name: str, message_type: str) -> int:
        """Add a topic to the bag.

        Args:
            name: full name of the topic.
            message_type: for example ``sensor_msgs/msg/JointState``.

        Returns:
            Index of the topic, for `write`.
        """
        types = typestore()
        definition, _ = types.generate_msgdef(message_type, ros_version=2)
        topic = _Topic(name, message_type, definition, types.hash_rihs01(message_type))
        self._topics.append(topic)
        if self._file:
            self._file.add_topic(topic)
        return len(self._topics) - 1

    def write(self, topic: int, time: int, data: bytes) -> None:
        """Add a message.

        Args:
            topic: index, see `add_topic`.
            time: time of reception, ns; must not decrease.
            data: serialized message.

        Raises:
            OSError: writing failed.
        """
        file = self._file
        if file is None:
            file = self._file = self._begin_file()
        file.write(topic, time, data)

    def flush(self) -> None:
        """Pass the collected messages to the operating system; finish the file if it is long enough.

        Raises:
            OSError: writing failed.
        """
        if not self._file or not self._file.content.messages:
            return
        self._file.flush()
        if self._file.size >= self._max_size or self._file.content.duration >= self._max_duration:
            self._finish_file()

    def close(self) -> None:
        """Finish the bag.

        Raises:
            OSError: writing failed.
        """
        self._finish_file()
        temporary = self._folder / ".metadata.yaml.tmp"
        information = {"rosbag2_bagfile_information": self._information(self._finished)}
        temporary.write_text(yaml.safe_dump(information, sort_keys=False), "utf-8")
        temporary.replace(self._folder / "metadata.yaml")

    def abort(self) -> None:
        """Give up the bag after a write error; it contains everything flushed before."""
        if self._file:
            self._file.abort()
            self._file = None

    def _begin_file(self) -> "_File":
        path = self._folder / f"{self._folder.name}_{len(self._finished)}.mcap"
        return _File(path, self._custom_data, self._topics)

    def _finish_file(self) -> None:
        if self._file:
            content = self._file.content
            self._file.finish(yaml.safe_dump(self._information([content]), sort_keys=False))
            self._finished.append(content)
            self._file = None

    def _information(self, files: Sequence["_Content"]) -> dict[str, Any]:
        """Content of ``metadata.yaml`` for these files of the bag, see rosbag2_storage::BagMetadata."""
        start = min(file.start for file in files)
        end = max(file.end for file in files)
        counts = [sum(file.counts[i] for file in files if i < len(file.counts)) for i in range(len(self._topics))]
        return {
            "version": _VERSION,
            "storage_identifier": "mcap",
            "duration": {"nanoseconds": max(0, end - start)},
            "starting_time": {"nanoseconds_since_epoch": start},
            "message_count": sum(counts),
            "topics_with_message_count": [
                {"topic_metadata": topic.information(), "message_count": count}
                for topic, count in zip(self._topics, counts, strict=True)
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file.name for file in files],
            "files": [file.information() for file in files],
            "custom_data": self._custom_data or None,
            "ros_distro": "jazzy",
        }


@dataclass(frozen=True)
class _Topic:
    """A topic of the bag.

    Attributes:
        name: full name.
        type: message type.
        definition: text of the type's .msg file, followed by those of its nested types.
        type_hash: hash of the type (REP 2011).
    """

    name: str
    type: str
    definition: str
    type_hash: str

    def information(self) -> dict[str, Any]:
        """Entry in ``metadata.yaml``."""
        return {
            "name": self.name,
            "type": self.type,
            "serialization_format": _ENCODING,
            "offered_qos_profiles": [],
            "type_description_hash": self.type_hash,
        }


@dataclass
class _Content:
    """Content of a file.

    Attributes:
        name: name of the file.
        start, end: times of the first and the last message, ns.
        counts: number of messages of each topic.
    """

    name: str
    start: int = _NEVER
    end: int = 0
    counts: list[int] = field(default_factory=list)

    @property
    def messages(self) -> int:
        """Number of messages of all topics."""
        return sum(self.counts)

    @property
    def duration(self) -> int:
        """Duration, ns; 0 without messages."""
        return max(0, self.end - self.start)

    def information(self) -> dict[str, Any]:
        """Entry in ``metadata.yaml``."""
        return {
            "path": self.name,
            "starting_time": {"nanoseconds_since_epoch": self.start},
            "duration": {"nanoseconds": self.duration},
            "message_count": self.messages,
        }


class _File:
    """A file of the bag while it is being written.

    Attributes:
        content: content so far.
    """

    def __init__(self, path: Path, custom_data: dict[str, str], topics: Sequence[_Topic]) -> None:
        self.content = _Content(path.name)
        self._stream = path.open("xb")
        # Checksums would take a tenth of the writing time.
        self._writer = Writer(self._stream, _LARGEST_CHUNK, CompressionType.NONE, enable_crcs=False)
        self._writer.start("ros2")
        # So that an unfinished bag or a single file also has the metadata of the run.
        self._writer.add_metadata(METADATA_KEY, custom_data)
        self._schemas: dict[str, int] = {}
        self._channels: list[int] = []
        for topic in topics:
            self.add_topic(topic)

    def add_topic(self, topic: _Topic) -> None:
        if topic.type not in self._schemas:
            schema = self._writer.register_schema(topic.type, "ros2msg", topic.definition.encode())
            self._schemas[topic.type] = schema
        about = {"offered_qos_profiles": "[]", "topic_type_hash": topic.type_hash}
        channel = self._writer.register_channel(topic.name, _ENCODING, self._schemas[topic.type], about)
        self._channels.append(channel)
        self.content.counts.append(0)

    def write(self, topic: int, time: int, data: bytes) -> None:
        self._writer.add_message(self._channels[topic], time, data, time)
        content = self.content
        content.counts[topic] += 1
        content.end = time
        if time < content.start:
            content.start = time

    def flush(self) -> None:
        self._writer.flush()  # type: ignore[no-untyped-call]

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return self._stream.tell()

    def finish(self, information: str) -> None:
        """End the file with an index and its entry of metadata.yaml, so that ``ros2 bag`` can read it alone too."""
        self.flush()
        self._writer.add_metadata("rosbag2", {"serialized_metadata": information})
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.close()

    def abort(self) -> None:
        """Close the file as it is."""
        with contextlib.suppress(OSError):  # Closing tries to write the rest.
            self._stream.close()
