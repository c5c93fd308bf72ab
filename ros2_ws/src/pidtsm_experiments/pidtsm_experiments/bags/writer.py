"""Writes a rosbag2 bag (MCAP) that can be read up to its last second, whatever happens to the writer."""

import contextlib
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import Writer as RecordWriter
from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter

from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.metadata import METADATA_KEY

_INFORMATION = "rosbag2_bagfile_information"
_LARGEST_CHUNK = 300_000
"""Bytes; a chunk is copied several times on its way to the file, and memory taken once is not given back."""


def free_space(path: Path) -> int:
    """Bytes that can be written where `path` is or is going to be."""
    return shutil.disk_usage(next(p for p in (path.absolute(), *path.absolute().parents) if p.exists())).free


class BagWriter:
    """A bag of one or more files, ``BAG/BAG_0.mcap``, ``BAG/BAG_1.mcap``, ..., and ``BAG/metadata.yaml``.

    Messages are collected in memory until `flush` hands them to the operating system as one whole chunk of the file;
    from then on they survive the end of this process. ``metadata.yaml`` is written by `close`: a bag without it was
    not finished, and `pidtsm_experiments.bags.recovery` reads it.
    """

    def __init__(self, folder: Path, metadata: str, max_size: int, max_duration: float) -> None:
        """Make the folder and its first file.

        Args:
            folder: must not exist.
            metadata: a text that goes with the bag, in ``metadata.yaml`` and at the begin of each file.
            max_size: bytes after which a new file is begun; 0: never.
            max_duration: s after which a new file is begun; 0: never.

        Raises:
            OSError: the folder exists, or cannot be written to.
        """
        folder.mkdir(parents=True)
        self._folder = folder
        self._metadata = metadata
        self._max_size, self._max_duration = max_size or float("inf"), 1e9 * max_duration or float("inf")
        self._types = typestore()
        self._topics: list[tuple[str, str]] = []
        self._connections: list[Connection] = []
        self._finished: list[str] = []  # Their metadata.yaml: as text they take a tenth of the memory.
        self._part: Writer | None = None
        self._begin_part()

    def add_topic(self, name: str, message_type: str) -> int:
        """The number under which `write` knows a topic with this full name and type."""
        self._topics.append((name, message_type))
        if self._part:
            self._connect(self._part, name, message_type)
        return len(self._topics) - 1

    def write(self, topic: int, time: int, data: bytes) -> None:
        """Take a message that was received at `time`, ns. Times must not decrease.

        Raises:
            OSError: nothing more can be written.
        """
        part = self._part or self._begin_part()
        part.write(self._connections[topic], time, data)
        storage = _storage(part)
        if storage.chunk.bio.tell() > _LARGEST_CHUNK:
            storage.close_chunk()

    def flush(self) -> None:
        """Hand what was taken to the operating system; begin a new file where this one is long enough.

        Raises:
            OSError: nothing more can be written.
        """
        if not self._part or not self._part.max_timestamp:
            return
        storage = _storage(self._part)
        if storage.chunk.msgs:
            storage.close_chunk()
            storage.bio.flush()
        duration = self._part.max_timestamp - self._part.min_timestamp
        if storage.bio.tell() >= self._max_size or duration >= self._max_duration:
            self._finish_part()

    def close(self) -> None:
        """Finish the bag.

        Raises:
            OSError: nothing more can be written.
        """
        self._finish_part()
        temporary = self._folder / ".metadata.yaml.tmp"
        parts = [yaml.safe_load(text)[_INFORMATION] for text in self._finished]
        temporary.write_text(yaml.safe_dump({_INFORMATION: _merged(parts)}, sort_keys=False), "utf-8")
        temporary.replace(self._folder / "metadata.yaml")

    def abort(self) -> None:
        """Let go of the bag where nothing more can be written; all until the last `flush` is in it."""
        if self._part:
            with contextlib.suppress(OSError):  # Closing writes what is left, in vain.
                self._part.abort()
            self._part = None

    def _begin_part(self) -> Writer:
        part = Writer(
            self._folder / f"{self._folder.name}_{len(self._finished)}", version=9, storage_plugin=StoragePlugin.MCAP
        )
        if self._metadata:
            part.set_custom_data(METADATA_KEY, self._metadata)
        part.open()
        # rosbags writes bags of one file, each in its folder; rosbag2 has the files of a bag in one folder.
        storage = _storage(part)
        storage.path = storage.path.rename(self._folder / storage.path.name)
        part.path.rmdir()
        part.metapath = self._folder / ".metadata.yaml"
        # So that an unfinished bag and a single file say what was run, too.
        RecordWriter(storage.bio).add_metadata(METADATA_KEY, {METADATA_KEY: self._metadata} if self._metadata else {})
        self._part = part
        self._connections = []
        for name, message_type in self._topics:
            self._connect(part, name, message_type)
        return part

    def _connect(self, part: Writer, name: str, message_type: str) -> None:
        self._connections.append(part.add_connection(name, message_type, typestore=self._types))

    def _finish_part(self) -> None:
        if not self._part:
            return
        self._part.close()
        said = self._part.metapath
        self._finished.append(said.read_text("utf-8"))
        said.unlink()
        self._part = None


def _storage(part: Writer) -> McapWriter:
    assert isinstance(part.storage, McapWriter)
    return part.storage


def _merged(parts: list[Mapping[str, Any]]) -> dict[str, Any]:
    """The metadata of a bag from those of its files."""
    files = [file for part in parts for file in part["files"]]
    filled = [file for file in files if file["message_count"]] or files[:1]
    start = min(_start(file) for file in filled)
    end = max(_start(file) + file["duration"]["nanoseconds"] for file in filled)
    return {
        **parts[-1],
        "relative_file_paths": [file["path"] for file in files],
        "files": files,
        "starting_time": {"nanoseconds_since_epoch": start},
        "duration": {"nanoseconds": end - start},
        "message_count": sum(part["message_count"] for part in parts),
        "topics_with_message_count": [
            {**topics[-1], "message_count": sum(topic["message_count"] for topic in topics)}
            for topics in _by_topic(parts)
        ],
    }


def _start(file: Mapping[str, Any]) -> int:
    return int(file["starting_time"]["nanoseconds_since_epoch"])


def _by_topic(parts: list[Mapping[str, Any]]) -> list[list[Mapping[str, Any]]]:
    """What each file says of a topic; a topic is in all files since it was added."""
    found: dict[str, list[Mapping[str, Any]]] = {}
    for part in parts:
        for topic in part["topics_with_message_count"]:
            found.setdefault(topic["topic_metadata"]["name"], []).append(topic)
    return list(found.values())
