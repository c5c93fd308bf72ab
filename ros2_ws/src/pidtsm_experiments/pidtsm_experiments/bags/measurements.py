"""Reads the joint states of any bag, also of other controllers, for identification."""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from pidtsm_core.identification.measurement import Measurement
from pidtsm_experiments.bags.columns import Columns, read_topic
from pidtsm_experiments.bags.errors import RecordingError, damaged
from pidtsm_experiments.bags.measured import held, reported_from
from pidtsm_experiments.bags.reader import open_bag
from pidtsm_experiments.bags.recovery import readable
from pidtsm_experiments.bags.topics import COMMANDED, SENSORS, TRUTH, WantedTopic, connections_with_messages

_MEASURED = WantedTopic(SENSORS.name, SENSORS.msgtype, ("position", "effort"), optional=("effort",))
_TRUE = WantedTopic(TRUTH.name, TRUTH.msgtype, ("position", "effort"))
_EFFORT = 1


def read_measurement(path: Path) -> tuple[Measurement, str]:
    """Positions and efforts of the topic ``joint_states`` of a bag, in any namespace.

    Efforts that the joint states do not have are those of ``joint_commands``. In the bag of a rollout, which has no
    joint states, positions and efforts are those of the ground truth. Joint states before the first with an effort are
    left out.

    Args:
        path: rosbag2 folder (MCAP or SQLite), or one .mcap or .db3 file; a bag that was not finished is read as far as
            possible.

    Returns:
        The measurement, and a description of what was used.

    Raises:
        RecordingError: not a bag, no joint states or those of two robots, or values that are missing or not finite.
    """
    try:
        with readable(path) as bag, closing(open_bag(path, bag)) as reader:
            joints, columns, source = _read(reader)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error.__cause__
    except Exception as error:  # Damaged files cause many kinds of exceptions, rosbags' own and Python's.
        raise RecordingError(f"{path}: {damaged('not a whole bag', error)}") from error
    if columns.stamps.size < 2:
        raise RecordingError(f"{path}: fewer than two joint states with different stamps")
    time = (columns.stamps - columns.stamps[0]) / 1e9
    position, effort = columns.values
    return Measurement(joints, time, position, effort, np.full(len(joints), np.inf)), source


def _read(reader: AnyReader) -> tuple[tuple[str, ...], Columns, str]:
    """Joints, positions and efforts, and a description of what was used."""
    topic, connections = _joint_states(list(reader.connections))
    joints, columns = read_topic(reader, topic, connections)
    if not np.isnan(columns.values[_EFFORT]).all():
        first = reported_from(columns, _EFFORT)
        return joints, columns.at(np.arange(first, columns.stamps.size)), f"{topic.name}, positions and efforts"
    connections = connections_with_messages(COMMANDED, reader.connections)
    if not connections:
        raise RecordingError(
            f"{topic.name} has 0 values of effort for {len(joints)} joints, and the bag has no {COMMANDED.name}"
        )
    _, commands = read_topic(reader, COMMANDED, connections, joints)
    # The effort before a joint state is that of a command for an earlier one.
    columns = columns.at(np.flatnonzero(columns.stamps > commands.stamps[0]))
    columns.values[_EFFORT] = held(commands.values[0], commands.stamps, columns.stamps - 1)
    return joints, columns, f"{topic.name}, positions; {COMMANDED.name}, efforts as commanded"


def _joint_states(connections: Sequence[Connection]) -> tuple[WantedTopic, list[Connection]]:
    """The topic to read, and its connections."""
    for wanted in (_MEASURED, _TRUE):
        if found := connections_with_messages(wanted, connections):
            return wanted, found
    present = sorted({f"{connection.topic} ({connection.msgtype})" for connection in connections})
    raise RecordingError(f"the bag has no messages joint_states ({SENSORS.msgtype}); it has {', '.join(present)}")
