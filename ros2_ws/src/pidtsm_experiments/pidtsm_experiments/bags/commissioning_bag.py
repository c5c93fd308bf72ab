"""The recordings of a commissioning as bags, for tools that read bags."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.topics import COMMANDS, REFERENCE, SENSORS
from pidtsm_experiments.bags.writer import BagWriter
from pidtsm_studies.commissioning.loop import Samples

_NANOSECONDS = 1_000_000_000


def write_commissioning_bag(samples: Samples, joints: tuple[str, ...], folder: Path) -> None:
    """Write ``joint_states``, ``reference`` and ``joint_commands`` of a recording; an existing bag is replaced.

    Args:
        samples: the recording.
        joints: names, in the order of its columns.
        folder: folder of the bag.

    Raises:
        OSError: it cannot be written.
    """
    unfinished = folder.with_name(f".{folder.name}")
    shutil.rmtree(unfinished, ignore_errors=True)
    writer = BagWriter(unfinished, "{}", 0, 0.0)
    topics = {topic: writer.add_topic(f"/{topic.name}", topic.msgtype) for topic in (SENSORS, REFERENCE, COMMANDS)}
    store, nothing, names = typestore(), np.empty(0), list(joints)
    types: Any = store.types
    for k, stamp in enumerate(samples.stamps.tolist()):
        time = types["builtin_interfaces/msg/Time"](*divmod(stamp, _NANOSECONDS))
        header = types["std_msgs/msg/Header"](time, "")
        values = {
            SENSORS: (samples.position[k], nothing, nothing),
            REFERENCE: (*samples.desired[k], np.zeros(len(joints))),
            COMMANDS: (nothing, nothing, samples.effort[k]),
        }
        for topic, fields in values.items():
            message = types[topic.msgtype](header, names, *fields)
            writer.write(topics[topic], stamp, bytes(store.serialize_cdr(message, topic.msgtype)))
    writer.close()
    shutil.rmtree(folder, ignore_errors=True)
    unfinished.replace(folder)
