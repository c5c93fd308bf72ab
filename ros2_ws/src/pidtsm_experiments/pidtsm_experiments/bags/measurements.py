"""Reads the joint states of any bag, also of other controllers, for identification."""

from contextlib import closing
from pathlib import Path

import numpy as np
from rosbags.interfaces import Connection

from pidtsm_core.identification.measurement import Measurement
from pidtsm_experiments.bags.columns import read_topic
from pidtsm_experiments.bags.errors import RecordingError, damaged
from pidtsm_experiments.bags.reader import open_bag
from pidtsm_experiments.bags.recovery import readable
from pidtsm_experiments.bags.topics import SENSORS, TRUTH, WantedTopic

_FIELDS = ("position", "effort")


def read_measurement(path: Path) -> Measurement:
    """Positions and efforts of the topic ``joint_states`` of a bag, in any namespace.

    In the bag of a rollout, which has no joint states, they are those of the ground truth.

    Args:
        path: rosbag2 folder (MCAP or SQLite), or one .mcap or .db3 file; a bag that was not finished is read as far as
            possible.

    Raises:
        RecordingError: not a bag, no joint states or those of two robots, or values that are missing or not finite.
    """
    try:
        with readable(path) as bag, closing(open_bag(path, bag)) as reader:
            topic, connections = _joint_states(list(reader.connections))
            joints, columns = read_topic(reader, topic, connections)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error.__cause__
    except Exception as error:  # Damaged files cause many kinds of exceptions, rosbags' own and Python's.
        raise RecordingError(f"{path}: {damaged('not a whole bag', error)}") from error
    if columns.stamps.size < 2:
        raise RecordingError(f"{path}: fewer than two joint states with different stamps")
    time = (columns.stamps - columns.stamps[0]) / 1e9
    return Measurement(joints, time, columns.values[0], columns.values[1], np.full(len(joints), np.inf))


def _joint_states(connections: list[Connection]) -> tuple[WantedTopic, list[Connection]]:
    """The topic to read, and its connections."""
    for wanted in (SENSORS, TRUTH):
        last = wanted.name.rpartition("/")[2]
        found = [c for c in connections if c.msgtype == wanted.msgtype and c.topic.rpartition("/")[2] == last]
        found = [connection for connection in found if connection.msgcount]
        names = sorted({connection.topic for connection in found})
        if len(names) > 1:
            raise RecordingError(f"more than one {last}: {', '.join(names)}; record one robot per bag")
        if found:
            return WantedTopic(wanted.name, wanted.msgtype, _FIELDS), found
    present = sorted({f"{connection.topic} ({connection.msgtype})" for connection in connections})
    raise RecordingError(f"the bag has no messages joint_states ({SENSORS.msgtype}); it has {', '.join(present)}")
