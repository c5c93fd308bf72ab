"""Somebody else's recorders, written from the standards alone: MCAP by mcap's own writer, and SQLite by Python's.

    python strangersrecorder.py FOLDER TOPIC=TYPE ...

They record to FOLDER/mcap.mcap and to the rosbag2 folder FOLDER/sqlite until SIGINT, and then what has arrived; nothing
of ours is imported.
"""

import importlib
import os
import signal
import sqlite3
import sys
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
import yaml
from ament_index_python.packages import get_package_share_directory
from mcap.writer import Writer
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

SILENCE = 0.5
"""s without a message after which everything has arrived."""
RELIABLE = QoSProfile(depth=10_000, reliability=ReliabilityPolicy.RELIABLE)
SCHEMA = """
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL,
    offered_qos_profiles TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
    encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
    data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
INSERT INTO schema(schema_version, ros_distro) VALUES (4, 'jazzy');
"""
"""Of rosbag2_storage_sqlite3, version 4."""


def definition(kind: str) -> str:
    """The installed .msg file of a type, followed by those of the types in it."""
    texts: dict[str, str] = {}

    def add(name: str) -> None:
        package, _, short = name.split("/")
        texts[name] = Path(get_package_share_directory(package), "msg", f"{short}.msg").read_text("utf-8")
        for line in texts[name].splitlines():
            used = line.partition("#")[0].split(" ")[0].partition("[")[0].split("/")
            inner = "/".join([used[0] if len(used) > 1 else package, "msg", used[-1]])
            if used[-1][:1].isupper() and inner not in texts:
                add(inner)

    add(kind)
    first, *others = texts.items()
    return first[1] + "".join(f"\n{'=' * 80}\nMSG: {name.replace('/msg/', '/')}\n{text}" for name, text in others)


class McapRecorder(Node):
    """One .mcap file, no folder about it."""

    def __init__(self, file: Path, topics: Mapping[str, str]) -> None:
        super().__init__("mcap_recorder")
        self.messages = 0
        self.stream = file.open("wb")
        self.writer = Writer(self.stream)
        self.writer.start("ros2")
        for topic, kind in topics.items():
            schema = self.writer.register_schema(kind, "ros2msg", definition(kind).encode())
            channel = self.writer.register_channel(topic, "cdr", schema)
            self.create_subscription(message(kind), topic, partial(self.write, channel), RELIABLE, raw=True)

    def write(self, channel: int, data: bytes) -> None:
        self.messages += 1
        now = time.time_ns()
        self.writer.add_message(channel, now, bytes(data), now)

    def close(self) -> None:
        self.writer.finish()  # type: ignore[no-untyped-call]
        self.stream.close()


class SqliteRecorder(Node):
    """A rosbag2 folder."""

    def __init__(self, folder: Path, topics: Mapping[str, str]) -> None:
        super().__init__("sqlite_recorder")
        self.messages = 0
        folder.mkdir()
        self.folder, self.topics = folder, topics
        self.database = sqlite3.connect(folder / "sqlite_0.db3")
        self.database.executescript(SCHEMA)
        for number, (topic, kind) in enumerate(topics.items(), start=1):
            self.database.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '', '')", (number, topic, kind))
            self.create_subscription(message(kind), topic, partial(self.write, number), RELIABLE, raw=True)
        for kind in sorted(set(topics.values())):
            row = (kind, definition(kind))
            self.database.execute("INSERT INTO message_definitions VALUES (NULL, ?, 'ros2msg', ?, '')", row)

    def write(self, topic: int, data: bytes) -> None:
        self.messages += 1
        row = (topic, time.time_ns(), bytes(data))
        self.database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", row)

    def close(self) -> None:
        """Finish the database, and write the metadata beside it."""
        self.database.commit()
        counts = dict(self.database.execute("SELECT topic_id, count(*) FROM messages GROUP BY topic_id"))
        first, last = self.database.execute("SELECT min(timestamp), max(timestamp) FROM messages").fetchone()
        self.database.close()
        span = {"starting_time": {"nanoseconds_since_epoch": first}, "duration": {"nanoseconds": last - first}}
        topics = [
            {"topic_metadata": about(topic, kind), "message_count": counts.get(number, 0)}
            for number, (topic, kind) in enumerate(self.topics.items(), start=1)
        ]
        total = sum(counts.values())
        information = {
            "version": 9,
            "storage_identifier": "sqlite3",
            **span,
            "message_count": total,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": ["sqlite_0.db3"],
            "files": [{"path": "sqlite_0.db3", **span, "message_count": total}],
            "custom_data": None,
            "ros_distro": "jazzy",
        }
        text = yaml.safe_dump({"rosbag2_bagfile_information": information})
        (self.folder / "metadata.yaml").write_text(text, encoding="utf-8")


def about(topic: str, kind: str) -> dict[str, Any]:
    return {
        "name": topic,
        "type": kind,
        "serialization_format": "cdr",
        "offered_qos_profiles": [],
        "type_description_hash": "",
    }


def message(kind: str) -> Any:
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def main(folder: Path, topics: Mapping[str, str]) -> None:
    """Record until SIGINT."""
    rclpy.init()
    executor = rclpy.executors.SingleThreadedExecutor()
    recorders = (McapRecorder(folder / "mcap.mcap", topics), SqliteRecorder(folder / "sqlite", topics))
    for recorder in recorders:
        executor.add_node(recorder)
    ended: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _frame: ended.append(number))
    parent = os.getppid()
    heard = time.monotonic()
    while os.getppid() == parent and not (ended and time.monotonic() - heard > SILENCE):
        before = [recorder.messages for recorder in recorders]
        executor.spin_once(timeout_sec=0.1)
        if before != [recorder.messages for recorder in recorders]:
            heard = time.monotonic()
    for recorder in recorders:
        recorder.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), dict(word.split("=") for word in sys.argv[2:]))
