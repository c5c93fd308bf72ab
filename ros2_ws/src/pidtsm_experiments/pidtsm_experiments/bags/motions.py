"""The recorded motion of the joints of any bag."""

from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Stamps
from pidtsm_core.timing import NANOSECONDS
from pidtsm_experiments.bags.columns import read_topic
from pidtsm_experiments.bags.errors import RecordingError, damaged
from pidtsm_experiments.bags.metadata import run_metadata
from pidtsm_experiments.bags.reader import open_bag
from pidtsm_experiments.bags.recovery import readable
from pidtsm_experiments.bags.topics import REFERENCE, SENSORS, TRUTH, WantedTopic, connections_with_messages

SOURCES: Mapping[str, tuple[WantedTopic, ...]] = {
    "joint_states": tuple(WantedTopic(topic.name, topic.msgtype, ("position",)) for topic in (SENSORS, TRUTH)),
    "reference": (WantedTopic(REFERENCE.name, REFERENCE.msgtype, ("position",), may_be_empty=True),),
}
"""Topics to read a motion from, by kind of position; the first one in the bag is used."""


class StampedPositions(NamedTuple):
    """Positions of a bag.

    Attributes:
        joints: names.
        stamps: of the messages, ns, increasing, shape (messages,).
        position: rad or m, shape (messages, joints).
        robot: parameters of the robot that the recorder has stored; empty if there are none.
    """

    joints: tuple[str, ...]
    stamps: Stamps
    position: Array
    robot: Mapping[str, object]


def read_positions(path: Path, source: str) -> tuple[tuple[str, ...], Array, Array, Mapping[str, object]]:
    """Names of the joints, time from the first message (s), positions and robot; see `read_stamped_positions`."""
    found = read_stamped_positions(path, source)
    return found.joints, (found.stamps - found.stamps[0]) / NANOSECONDS, found.position, found.robot


def read_stamped_positions(path: Path, source: str) -> StampedPositions:
    """Positions of a bag, in any namespace.

    Args:
        path: rosbag2 folder (MCAP or SQLite), or one .mcap or .db3 file; a bag that was not finished is read as far as
            possible.
        source: one of `SOURCES`.

    Raises:
        RecordingError: not a bag, no such topic or those of two robots, or values that are missing or not finite.
    """
    try:
        with readable(path) as bag, closing(open_bag(path, bag)) as reader:
            robot = run_metadata(path, bag).robot
            for topic in SOURCES[source]:
                if connections := connections_with_messages(topic, reader.connections):
                    joints, columns = read_topic(reader, topic, connections)
                    columns = columns.at(np.flatnonzero(columns.filled))
                    return StampedPositions(joints, columns.stamps, columns.values[0], robot)
            present = sorted({f"{each.topic} ({each.msgtype})" for each in reader.connections})
            raise RecordingError(f"the bag has no messages {source}; it has {', '.join(present)}")
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error.__cause__
    except Exception as error:  # Damaged files cause many kinds of exceptions, rosbags' own and Python's.
        raise RecordingError(f"{path}: {damaged('not a whole bag', error)}") from error
