"""Judges of a bag that we did not write: rosbags, mcap-ros2-support and rclpy, each by itself."""

import importlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from pidtsm_experiments.bags.recovery import readable
from pidtsm_ros.serialization import serialize


def get_message(kind: str) -> Any:
    """The class of rclpy of a message type."""
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def content(message: Any, fields: Any) -> Any:
    """Everything in a message of any library, numbers as bits; `fields`: of an rclpy message of the type."""
    if hasattr(fields, "get_fields_and_field_types"):
        names = fields.get_fields_and_field_types()
        return [content(getattr(message, name), getattr(fields, name)) for name in names]
    if isinstance(fields, float):
        return np.float64(message).tobytes()
    if isinstance(fields, bytes):
        return message[0] if isinstance(message, bytes) else message
    if isinstance(fields, (str, int, bool)):
        return message
    return [content(each, like) for each, like in zip(message, fields, strict=True)]


@contextmanager
def opened(bag: Path) -> Iterator[tuple[AnyReader, IO[bytes]]]:
    """A bag of one file in rosbags' reader, and the file; also one whose recorder was killed on a busy machine."""
    with readable(bag) as rest:
        (path,) = rest.files
        (file,) = path.glob("*.mcap") if path.is_dir() else [path]
        store = get_typestore(Stores.ROS2_JAZZY)
        with AnyReader([path], default_typestore=store) as reader, file.open("rb") as stream:
            yield reader, stream


def messages(bag: Path, before: int | None = None) -> Iterator[tuple[str, str, bytes, Any, Any]]:
    """Topic, type, bytes, and what rosbags alone and mcap-ros2-support alone make of each message.

    Args:
        bag: of one file.
        before: only messages received before this time, ns.
    """
    with opened(bag) as (reader, stream):
        ours = sorted(reader.messages(stop=before), key=lambda each: (each[1], each[0].topic))
        theirs = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(ending_before=before)
        decoded = sorted(theirs, key=lambda each: (each[2].log_time, each[1].topic))
        for (connection, time, data), (_, channel, message, value) in zip(ours, decoded, strict=True):
            assert (time, connection.topic, data) == (message.log_time, channel.topic, message.data)
            yield connection.topic, connection.msgtype, data, reader.deserialize(data, connection.msgtype), value


def received(bag: Path, topic: str) -> list[int]:
    """When the messages of a topic were received, ns."""
    with opened(bag) as (reader, _):
        return [time for _, time, _ in reader.messages([each for each in reader.connections if each.topic == topic])]


def judged(bag: Path, before: int | None = None) -> Counter[str]:
    """The number of messages of each topic, by its name without the first slash; `before`: see `messages`.

    All three libraries read the same numbers from every message, whose bytes are all part of it.
    """
    counts: Counter[str] = Counter()
    for topic, kind, data, of_rosbags, of_mcap in messages(bag, before):
        message = deserialize_message(data, get_message(kind))
        expected = content(message, message)
        assert content(of_rosbags, message) == expected == content(of_mcap, message), topic
        exact = serialize(message)
        rest = data[len(exact) :]  # DDS fills up to a multiple of four bytes.
        assert data.startswith(exact), f"{topic} is not what it should be"
        assert not any(rest), f"{topic} has bytes that are not part of it"
        assert len(rest) < 4
        counts[topic.lstrip("/")] += 1
    return counts
