"""A run, and functions that write its bags, intact or damaged."""

import json
import signal
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Signal
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.metadata import METADATA_KEY

# A shell's background jobs ignore SIGINT, and so would the processes that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

Edit: TypeAlias = Callable[[str, int, Any], Any]
WriteBag: TypeAlias = Callable[..., Path]

METADATA: Mapping[str, Any] = {"scenario": "case1", "law": "piddtsm", "clock": "lockstep", "event_time": None}
COMPUTE_TIME = 2e-5  # s
REJECTED = "messages rejected since the start"
LOOP = (0.001, 1000.0, 2e-5, 3e-4, 0.0)  # period, rate, period_jitter, state_age, missed_deadlines


@pytest.fixture(scope="session")
def run() -> Recording:
    """Two seconds of Case 1."""
    return rollout(duration=2.0)


@dataclass(frozen=True)
class Sent:
    """A message of a run.

    Attributes:
        topic: name without namespace.
        k: index of the sample.
        message: message object of rosbags; shared between tests, do not modify.
        payload: the serialized message.
    """

    topic: str
    k: int
    message: Any
    payload: bytes


def sent(run: Recording) -> list[Sent]:
    """Messages that the nodes publish in a run, in order."""
    store = typestore()
    types = store.types
    joint_state = types["sensor_msgs/msg/JointState"]
    reference = types["pidtsm_msgs/msg/JointReference"]
    state = types["pidtsm_msgs/msg/ControllerState"]
    names, nothing = list(run.joints), np.empty(0)
    messages = []
    for k, t in enumerate(run.time):
        time = types["builtin_interfaces/msg/Time"](*divmod(round(t * 1e9), 1_000_000_000))
        header = types["std_msgs/msg/Header"](time, "")
        signals = run.signals[k]
        for topic, message in {
            "joint_states": joint_state(header, names, run.position[k], run.velocity[k], nothing),
            "reference": reference(header, names, *run.reference[k], nothing),
            "joint_commands": joint_state(header, names, nothing, nothing, signals[Signal.EFFORT]),
            "controller/state": state(header, names, *signals, *run.status[k].tolist(), *LOOP, COMPUTE_TIME),
            "simulator/ground_truth": joint_state(header, names, run.position[k], run.velocity[k], run.effort[k]),
        }.items():
            messages.append(Sent(topic, k, message, serialized(message)))
    return messages


def serialized(message: Any) -> bytes:
    """Serialize a message of rosbags."""
    return bytes(typestore().serialize_cdr(message, message.__msgtype__))


def report(rejected: Mapping[str, str]) -> Any:
    """A message on /diagnostics.

    Args:
        rejected: number of rejected messages by node name; the controller has also found friction.
    """
    types = typestore().types
    pair, status = types["diagnostic_msgs/msg/KeyValue"], types["diagnostic_msgs/msg/DiagnosticStatus"]
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "")
    found = [pair("found friction of joint1 (N m)", "6.1"), pair("found friction of joint1, deviation (N m)", "0.3")]
    statuses = [
        status(
            0,
            f"{node}: loop",
            "running",
            "",
            [pair("rate (1/s)", "1"), pair(REJECTED, count), *(found if node.endswith("controller") else [])],
        )
        for node, count in rejected.items()
    ]
    return types["diagnostic_msgs/msg/DiagnosticArray"](header, statuses)


def write_reports(writer: Writer, time: int, reports: Sequence[Mapping[str, str]]) -> None:
    """Write messages on /diagnostics, all with the same time (ns), see `report`."""
    for k, message in enumerate(map(report, reports)):
        if k == 0:
            connection = writer.add_connection("/diagnostics", message.__msgtype__, typestore=typestore())
        writer.write(connection, time, serialized(message))


@pytest.fixture(scope="session")
def write_bag() -> WriteBag:
    """A function that writes a bag like the recorder; see `write` for its arguments."""
    # Cache of the messages of the latest runs; nearly all tests use the same run.
    latest: deque[tuple[Recording, list[Sent]]] = deque(maxlen=4)

    def messages_of(run: Recording) -> list[Sent]:
        for known, messages in latest:
            if known is run:
                return messages
        latest.append((run, sent(run)))
        return latest[-1][1]

    def write(
        path: Path,
        run: Recording,
        edit: Edit | None = None,
        metadata: Mapping[str, Any] | str | None = METADATA,
        namespace: str = "",
        lacking: tuple[str, ...] = (),
        plugin: StoragePlugin = StoragePlugin.MCAP,
        reports: Sequence[Mapping[str, str]] = (),
    ) -> Path:
        """Write a bag.

        Args:
            path: folder of the bag.
            run: the run.
            edit: called with topic (without namespace), index of the sample and message; returns the message to write
                instead, or None to omit it.
            metadata: the recorder's metadata of the run.
            namespace: prefix of every topic.
            lacking: topics that are omitted.
            plugin: storage plugin.
            reports: messages on /diagnostics at the end, see `report`.
        """
        with Writer(path, version=9, storage_plugin=plugin) as writer:
            if metadata is not None:
                text = metadata if isinstance(metadata, str) else json.dumps(metadata)
                writer.set_custom_data(METADATA_KEY, text)
            connections: dict[str, Any] = {}
            time = 0
            for one in messages_of(run):
                if one.topic in lacking:
                    continue
                if one.topic not in connections:
                    kind = one.message.__msgtype__
                    name = f"{namespace}/{one.topic}"
                    connections[one.topic] = writer.add_connection(name, kind, typestore=typestore())
                edited = edit(one.topic, one.k, one.message) if edit else one.message
                time = round(run.time[one.k] * 1e9)
                if edited is not None:
                    payload = one.payload if edited is one.message else serialized(edited)
                    writer.write(connections[one.topic], time, payload)
            write_reports(writer, time, reports)
        return path

    return write
