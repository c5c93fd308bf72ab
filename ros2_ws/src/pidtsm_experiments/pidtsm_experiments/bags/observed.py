"""What anybody can see of a loop in its bag: joint states, commands and references, of this project or of others."""

import warnings
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Stamps
from pidtsm_core.signals import Fault, Mode, Status
from pidtsm_experiments.bags.columns import Columns, read_topic
from pidtsm_experiments.bags.errors import RecordingError, UnfinishedBag, damaged
from pidtsm_experiments.bags.measured import held
from pidtsm_experiments.bags.metadata import run_metadata
from pidtsm_experiments.bags.reader import open_bag
from pidtsm_experiments.bags.recovery import readable
from pidtsm_experiments.bags.topics import (
    COMMANDED,
    REFERENCE,
    SENSORS,
    STATE,
    TRUTH,
    WantedTopic,
    connections_with_messages,
)
from pidtsm_studies.diagnosis.observed import Observed

_JOINT_STATE = SENSORS.msgtype
_MEASURED = WantedTopic(SENSORS.name, _JOINT_STATE, ("position", "effort"), optional=("effort",))
_TRUE = WantedTopic(TRUTH.name, _JOINT_STATE, ("position", "effort"))
_MOTION = WantedTopic(REFERENCE.name, REFERENCE.msgtype, ("position",), may_be_empty=True)
_PLAIN = WantedTopic(REFERENCE.name, _JOINT_STATE, ("position",))
_SAID = WantedTopic(STATE.name, STATE.msgtype, (), codes=STATE.codes)
_EFFORT = 1
_LATEST = 0.1
"""s; an older reference is none."""


def read_observed(path: Path) -> tuple[Observed, str]:
    """Read what a diagnosis needs of a bag.

    Joint states without effort get that of ``joint_commands``. The bag of a rollout has no joint states; its ground
    truth takes their place. References and the controller's state are used if they are there.

    Args:
        path: rosbag2 folder (MCAP or SQLite), or one .mcap or .db3 file; a bag that was not finished is read as far as
            possible, with the warning `UnfinishedBag`.

    Returns:
        The recording, and a sentence about what was used.

    Raises:
        RecordingError: not a bag, no joint states or those of two robots, values that are missing or not finite.
    """
    try:
        with readable(path) as bag, closing(open_bag(path, bag)) as reader:
            observed, source = _read(reader, run_metadata(path, bag).sliding)
            if bag.flaws:
                warnings.warn(UnfinishedBag(f"{path}: {'; '.join(bag.flaws)}"), stacklevel=2)
            return observed, source
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error.__cause__
    except Exception as error:  # Damaged files cause many kinds of exceptions, rosbags' own and Python's.
        raise RecordingError(f"{path}: {damaged('not a whole bag', error)}") from error


def _read(reader: AnyReader, sliding: Sequence[str]) -> tuple[Observed, str]:
    connections = list(reader.connections)
    topic, found = _joint_states(connections)
    joints, states = read_topic(reader, topic, found)
    if states.stamps.size < 2:
        raise RecordingError(f"{topic.name} has fewer than two messages with different stamps")
    commands = _optional(reader, COMMANDED, connections, joints)
    position, effort = states.values
    known = np.isfinite(effort).all(axis=1)
    command = None if commands is None else _answers(commands, states.stamps)
    reported = bool(known.any())
    rows = np.flatnonzero(known) if reported else np.arange(states.stamps.size)
    if not reported:
        if command is None or commands is None:
            raise RecordingError(f"{topic.name} has no efforts, and the bag has no {COMMANDED.name}")
        effort = held(commands.values[0], commands.stamps, states.stamps - 1)
    elif topic is _TRUE:
        effort = np.vstack([effort[:1], effort[:-1]])  # There, an effort is that applied after its stamp.
    stamps = states.stamps[rows]
    following, stopped = _status(reader, connections, joints, stamps)
    reference = _reference(reader, connections, joints, stamps)
    others = {COMMANDED.name: commands is not None, REFERENCE.name: reference is not None}
    used = [topic.name, *(name for name, is_there in others.items() if is_there)]
    return (
        Observed(
            joints=joints,
            time=(stamps - stamps[0]) / 1e9,
            position=position[rows],
            effort=effort[rows],
            command=None if command is None else command[rows],
            reference=reference,
            following=following,
            slides=tuple(joint in sliding for joint in joints) if sliding else (),
            stopped=stopped,
            effort_is_command=not reported,
        ),
        ", ".join(used),
    )


def _joint_states(connections: Sequence[Connection]) -> tuple[WantedTopic, list[Connection]]:
    """The topic of the arm's motion: what was measured, else the ground truth."""
    for wanted in (_MEASURED, _TRUE):
        if found := connections_with_messages(wanted, connections):
            return wanted, found
    present = sorted({f"{connection.topic} ({connection.msgtype})" for connection in connections})
    raise RecordingError(f"the bag has no messages joint_states ({_JOINT_STATE}); it has {', '.join(present)}")


def _optional(
    reader: AnyReader, topic: WantedTopic, connections: Sequence[Connection], joints: tuple[str, ...]
) -> Columns | None:
    """The messages of a topic for these joints; None: there are none."""
    found = connections_with_messages(topic, connections)
    return read_topic(reader, topic, found, joints)[1] if found else None


def _answers(commands: Columns, stamps: Stamps) -> Array:
    """The command with the stamp of each joint state, else the last one before, shape (stamps, joints)."""
    return held(commands.values[0], commands.stamps, stamps)


def _reference(
    reader: AnyReader, connections: Sequence[Connection], joints: tuple[str, ...], stamps: Stamps
) -> Array | None:
    """Desired positions at the stamps, nan where there is none, shape (stamps, joints); None: the bag has none."""
    for topic in (_MOTION, _PLAIN):
        columns = _optional(reader, topic, connections, joints)
        if columns is None or not columns.filled.any():
            continue
        known = columns.at(np.flatnonzero(columns.filled))
        at = np.stack([np.interp(stamps, known.stamps, column) for column in known.values[0].T], axis=1)
        last = np.searchsorted(known.stamps, stamps, side="right") - 1
        age = (stamps - known.stamps[np.maximum(last, 0)]) / 1e9
        at[(last < 0) | (age > _LATEST)] = np.nan
        return None if np.isnan(at).all() else at
    return None


def _status(
    reader: AnyReader, connections: Sequence[Connection], joints: tuple[str, ...], stamps: Stamps
) -> tuple[NDArray[np.bool_] | None, str]:
    """Whether the controller follows at each stamp, and why it has stopped; None and empty: it does not say."""
    columns = _optional(reader, _SAID, connections, joints)
    if columns is None or not columns.stamps.size:
        return None, ""
    rows = np.maximum(np.searchsorted(columns.stamps, stamps, side="right") - 1, 0)
    codes = columns.codes[rows]
    faults = codes[codes[:, Status.FAULT] > 0, Status.FAULT]
    stopped = Fault(int(faults[0])).name.lower().replace("_", " ") if faults.size else ""
    return codes[:, Status.MODE] == Mode.FOLLOWING, stopped
