"""A run, and bags of it: good ones and broken ones."""

import json
import signal
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from pidtsm_core.rollout import Rollout, rollout
from pidtsm_core.signals import Signal
from pidtsm_experiments.bags.reader import METADATA_KEY, typestore

# A shell's background jobs ignore SIGINT, and so would the processes that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

Edit: TypeAlias = Callable[[str, int, Any], Any]
WriteBag: TypeAlias = Callable[..., Path]

METADATA: Mapping[str, Any] = {"scenario": "case1", "law": "piddtsm", "clock": "lockstep", "event_time": None}
COMPUTE_TIME = 2e-5  # s
REJECTED = "messages rejected since the start"
LOOP = (0.001, 1000.0, 2e-5, 3e-4, 0.0)  # period, rate, period_jitter, state_age, missed_deadlines


@pytest.fixture(scope="session")
def run() -> Rollout:
    """Two seconds of Case 1."""
    return rollout({}, 2.0)


@pytest.fixture(scope="session")
def write_bag() -> WriteBag:
    """See `_write_bag`."""
    return _write_bag


def _write_bag(
    path: Path,
    run: Rollout,
    edit: Edit = lambda topic, k, message: message,
    metadata: Mapping[str, Any] | str | None = METADATA,
    namespace: str = "",
    lacking: tuple[str, ...] = (),
    plugin: StoragePlugin = StoragePlugin.MCAP,
    start: int = 0,
    reports: Sequence[Mapping[str, str]] = (),
) -> Path:
    """Write a bag as the recorder would.

    Args:
        path: the bag.
        run: what happened.
        edit: gets topic (without namespace), number of the sample and message; gives the message to write instead,
            or None to lose it.
        metadata: what the recorder says of the run.
        namespace: before every topic.
        lacking: topics that are not in the bag.
        plugin: storage.
        start: stamp of the first sample, ns.
        reports: what comes on /diagnostics in the end: by the name of the node, how many messages it has rejected.
    """
    store = typestore()
    types = store.types
    joint_state = types["sensor_msgs/msg/JointState"]
    reference = types["pidtsm_msgs/msg/JointReference"]
    state = types["pidtsm_msgs/msg/ControllerState"]
    names, nothing = list(run.joints), np.empty(0)
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        if metadata is not None:
            text = metadata if isinstance(metadata, str) else json.dumps(metadata)
            writer.set_custom_data(METADATA_KEY, text)
        connections: dict[str, Any] = {}
        for k, t in enumerate(run.time):
            stamp = start + round(t * 1e9)
            time = types["builtin_interfaces/msg/Time"](*divmod(stamp, 1_000_000_000))
            header = types["std_msgs/msg/Header"](time, "")
            signals = run.signals[k]
            for topic, message in {
                "joint_states": joint_state(header, names, run.position[k], run.velocity[k], nothing),
                "reference": reference(header, names, *run.reference[k]),
                "joint_commands": joint_state(header, names, nothing, nothing, signals[Signal.EFFORT]),
                "controller/state": state(header, names, *signals, *run.status[k].tolist(), *LOOP, COMPUTE_TIME),
                "simulator/ground_truth": joint_state(header, names, run.position[k], run.velocity[k], run.effort[k]),
            }.items():
                if topic in lacking:
                    continue
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(f"{namespace}/{topic}", kind, typestore=store)
                if (edited := edit(topic, k, message)) is not None:
                    writer.write(connections[topic], stamp, store.serialize_cdr(edited, kind))
        for report in reports:
            kind = "diagnostic_msgs/msg/DiagnosticArray"
            if "diagnostics" not in connections:
                connections["diagnostics"] = writer.add_connection("/diagnostics", kind, typestore=store)
            pair, status = types["diagnostic_msgs/msg/KeyValue"], types["diagnostic_msgs/msg/DiagnosticStatus"]
            told = [
                status(0, f"{node}: loop", "running", "", [pair("rate (1/s)", "1"), pair(REJECTED, count)])
                for node, count in report.items()
            ]
            message = types[kind](header, told)
            writer.write(connections["diagnostics"], stamp, store.serialize_cdr(message, kind))
    return path
