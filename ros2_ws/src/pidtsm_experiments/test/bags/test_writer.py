"""Bags match those of rosbag2, and flushed messages are readable even if the writer is killed."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.metadata import METADATA_KEY
from pidtsm_experiments.bags.recovery import readable, stored_metadata
from pidtsm_experiments.bags.writer import BagWriter

TOPICS = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/joint_commands": "sensor_msgs/msg/JointState",
    "/controller/state": "pidtsm_msgs/msg/ControllerState",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}
METADATA = json.dumps({"scenario": "case1"})
PERIOD = 1_000_000  # ns
START = 1_700_000_000_000_000_000


def payload(k: int, size: int = 100) -> bytes:
    return b"\x00\x01\x00\x00" + k.to_bytes(4, "little") + bytes(size - 8)


def messages(topics: int, count: int) -> list[tuple[int, int, bytes]]:
    """Index of the topic, time and payload; the last topic has none."""
    return [(k % (topics - 1), START + k * PERIOD, payload(k)) for k in range(count)]


def begin(folder: Path, max_size: int = 0, max_duration: float = 0.0, metadata: str = METADATA) -> BagWriter:
    writer = BagWriter(folder, metadata, max_size, max_duration)
    for name, kind in TOPICS.items():
        writer.add_topic(name, kind)
    return writer


def write(writer: BagWriter, count: int, flush_every: int = 100) -> list[tuple[int, int, bytes]]:
    sent = messages(len(TOPICS), count)
    for k, (topic, time, data) in enumerate(sent, 1):
        writer.write(topic, time, data)
        if k % flush_every == 0:
            writer.flush()
    return sent


def read(files: list[Path]) -> list[tuple[int, int, bytes]]:
    names = list(TOPICS)
    with AnyReader(files) as reader:
        return [(names.index(connection.topic), time, data) for connection, time, data in reader.messages()]


def information(bag: Path) -> dict[str, Any]:
    return yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def contents(file: Path) -> tuple[dict[int, Schema], dict[int, Channel], list[Message]]:
    """Schemas and channels of the index, and all messages."""
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        return summary.schemas, summary.channels, [message for _, _, message in reader.iter_messages()]


@pytest.mark.parametrize("count", [0, 300])
@pytest.mark.parametrize("metadata", [METADATA, ""])
def test_a_bag_of_one_file_is_what_rosbags_writes(tmp_path: Path, count: int, metadata: str) -> None:
    writer = begin(tmp_path / "own" / "bag", metadata=metadata)
    sent = write(writer, count)
    writer.close()
    # rosbags names the file of a bag without a number.
    with Writer(tmp_path / "bag_0", version=9, storage_plugin=StoragePlugin.MCAP) as other:
        if metadata:
            other.set_custom_data(METADATA_KEY, metadata)
        connections = [other.add_connection(name, kind, typestore=typestore()) for name, kind in TOPICS.items()]
        for topic, time, data in sent:
            other.write(connections[topic], time, data)
    ours, theirs = information(tmp_path / "own" / "bag"), information(tmp_path / "bag_0")
    assert (ours.pop("ros_distro"), theirs.pop("ros_distro")) == ("jazzy", "rosbags")
    assert ours == theirs
    schemas, channels, stored = contents(tmp_path / "own" / "bag" / "bag_0.mcap")
    # rosbag2 writes the hashes to the file, too; rosbags does not.
    hashes = {channel.topic: channel.metadata.pop("topic_type_hash") for channel in channels.values()}
    topics = [topic["topic_metadata"] for topic in ours["topics_with_message_count"]]
    assert hashes == {topic["name"]: topic["type_description_hash"] for topic in topics}
    assert (schemas, channels, stored) == contents(tmp_path / "bag_0" / "bag_0.mcap")


@pytest.mark.parametrize("limits", [{"max_size": 20_000}, {"max_duration": 0.2}])
def test_a_bag_may_have_many_files(tmp_path: Path, limits: Any) -> None:
    bag = tmp_path / "bag"
    writer = begin(bag, **limits)
    sent = write(writer, 950)
    writer.close()
    about = information(bag)
    files = about["relative_file_paths"]
    assert len(files) > 3
    assert sorted(path.name for path in bag.iterdir()) == [*files, "metadata.yaml"]
    assert read([bag]) == sent
    begun = 0
    for file in about["files"]:
        part = read([bag / file["path"]])
        assert part == sent[begun : begun + file["message_count"]]
        assert file["starting_time"]["nanoseconds_since_epoch"] == part[0][1]
        assert file["duration"]["nanoseconds"] == part[-1][1] - part[0][1]
        assert stored_metadata(bag / file["path"], METADATA_KEY) == {METADATA_KEY: METADATA}
        begun += len(part)
    assert begun == about["message_count"] == len(sent)
    assert about["duration"]["nanoseconds"] == 949 * PERIOD
    counts = [topic["message_count"] for topic in about["topics_with_message_count"]]
    assert counts == [sum(topic == i for topic, _, _ in sent) for i in range(len(TOPICS))]


def test_a_single_file_contains_the_metadata_that_rosbag2_needs(tmp_path: Path) -> None:
    writer = begin(tmp_path / "bag", max_size=20_000)
    write(writer, 950)
    writer.close()
    file = tmp_path / "bag" / "bag_1.mcap"
    with file.open("rb") as stream:
        (record,) = [record for record in make_reader(stream).iter_metadata() if record.name == "rosbag2"]
    about = yaml.safe_load(record.metadata["serialized_metadata"])
    assert about["relative_file_paths"] == ["bag_1.mcap"]
    assert about["message_count"] == len(read([file]))
    assert about["custom_data"] == {METADATA_KEY: METADATA}


def test_what_was_flushed_can_be_read_while_the_bag_is_written(tmp_path: Path) -> None:
    bag, copy = tmp_path / "bag", tmp_path / "copy"
    writer = begin(bag, max_size=20_000)
    sent = write(writer, 950, flush_every=50)
    for k in range(7):
        writer.write(0, sent[-1][1] + k, payload(k))
    shutil.copytree(bag, copy)  # the same as the bag of a recorder that is killed now
    with readable(copy) as rest:
        assert read(rest.files) == sent
        assert all(stored_metadata(file, METADATA_KEY) == {METADATA_KEY: METADATA} for file in rest.files)
    writer.abort()
    assert not (bag / "metadata.yaml").exists()


def test_a_topic_may_be_added_later(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", "", max_size=1, max_duration=0.0)
    names = list(TOPICS)[:3]
    for k, name in enumerate(names):
        assert writer.add_topic(name, TOPICS[name]) == k
        writer.write(k, START + k, payload(k))
        writer.flush()
    writer.close()
    assert read([tmp_path / "bag"]) == [(k, START + k, payload(k)) for k in range(3)]
    with Reader(tmp_path / "bag") as reader:
        assert [(c.topic, c.msgtype, c.msgcount) for c in reader.connections] == [(n, TOPICS[n], 1) for n in names]


def test_chunks_are_small(tmp_path: Path) -> None:
    """Even if flushes are rare, because a process never releases its memory."""
    writer = begin(tmp_path / "bag")
    for k in range(500):
        writer.write(0, START + k, payload(k, 4000))
    writer.close()
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) > 5
    assert max(chunk.uncompressed_size for chunk in summary.chunk_indexes) < 300_000 + 5000


def test_a_bag_that_exists_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    with pytest.raises(FileExistsError):
        begin(tmp_path / "bag")
    assert list((tmp_path / "bag").iterdir()) == []
