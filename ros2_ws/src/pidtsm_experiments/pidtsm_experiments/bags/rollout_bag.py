"""A rollout as a bag, for tools that read bags."""

import json
from collections.abc import Mapping
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Value, joint_array, names
from pidtsm_core.recording import Recording
from pidtsm_core.signals import Signal
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.topics import COMMANDS, REFERENCE, STATE, TRUTH, WantedTopic
from pidtsm_experiments.bags.writer import BagWriter

_NOT_MEASURED = (0.0,) * 6
"""What a node measures of itself, at the end of `ControllerState`."""


def write_rollout_bag(recording: Recording, trajectory: Mapping[str, Value], folder: Path) -> None:
    """Write the messages that nodes would have published, except the measured ``joint_states``, as one file.

    Every topic has one message for each sample, even if the rollout loses some.

    Args:
        recording: of a rollout.
        trajectory: every parameter of the trajectory.
        folder: folder of the bag; it must not exist.

    Raises:
        OSError: the folder exists or cannot be written.
    """
    writer = BagWriter(folder, _metadata(recording, trajectory), 0, 0.0)
    order = names(trajectory["joints"])
    feedforward = joint_array(trajectory["feedforward.effort"], len(order))
    feedforward = feedforward[[order.index(joint) for joint in recording.joints]]
    topics = {topic: writer.add_topic(f"/{topic.name}", topic.msgtype) for topic in (TRUTH, REFERENCE, STATE, COMMANDS)}
    store = typestore()
    for k, stamp in enumerate(recording.stamps_ns.tolist()):
        for topic, message in _messages(recording, k, feedforward).items():
            writer.write(topics[topic], stamp, bytes(store.serialize_cdr(message, topic.msgtype)))
    writer.close()


def _metadata(recording: Recording, trajectory: Mapping[str, Value]) -> str:
    """What the recorder stores in the bag of a run; see `metadata.RunMetadata`."""
    joints = recording.joints
    known = {
        "scenario": recording.scenario,
        "law": recording.law,
        "event_time": recording.event_time,
        "trajectory": trajectory,
        "robot": recording.robot,
        "sliding": list(compress(joints, recording.slides)),
        "continuous": list(compress(joints, recording.continuous)),
    }
    return json.dumps(known)


def _messages(recording: Recording, k: int, feedforward: Array) -> dict[WantedTopic, Any]:
    """The messages of a sample, by topic; `feedforward` is that of the references, shape (joints,), N m."""
    types = typestore().types
    time = types["builtin_interfaces/msg/Time"](*divmod(int(recording.stamps_ns[k]), 1_000_000_000))
    header = types["std_msgs/msg/Header"](time, "")
    joints, nothing, signals = list(recording.joints), np.empty(0), recording.signals[k]
    values = {
        TRUTH: (recording.position[k], recording.velocity[k], recording.effort[k]),
        REFERENCE: (*recording.reference[k], feedforward),
        STATE: (*signals, *recording.status[k].tolist(), *_NOT_MEASURED),
        COMMANDS: (nothing, nothing, signals[Signal.EFFORT]),
    }
    return {topic: types[topic.msgtype](header, joints, *fields) for topic, fields in values.items()}
