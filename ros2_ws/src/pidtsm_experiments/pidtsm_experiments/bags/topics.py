"""The topics of a run: how to find them in a bag, and which fields to read."""

from collections.abc import Sequence
from dataclasses import dataclass

from rosbags.interfaces import Connection

from pidtsm_core.signals import Signal, Status
from pidtsm_experiments.bags.errors import RecordingError

_JOINT_STATE = "sensor_msgs/msg/JointState"


@dataclass(frozen=True)
class WantedTopic:
    """A topic to look for in a bag, in any namespace.

    Attributes:
        name: name in `Recording.lost`; its last part must be that of the topic.
        msgtype: message type.
        fields: float64[] fields to read, one value per joint.
        scalar: float64 field to read, or empty.
        codes: uint8 fields to read; 0 if missing in an older version of the message.
        may_be_empty: whether messages without joints are allowed; they mean that there are no values.
        optional: fields that may be empty, or nan where there is no value; both are read as nan.
    """

    name: str
    msgtype: str
    fields: tuple[str, ...] = ()
    scalar: str = ""
    codes: tuple[str, ...] = ()
    may_be_empty: bool = False
    optional: tuple[str, ...] = ()


TRUTH = WantedTopic("simulator/ground_truth", _JOINT_STATE, ("position", "velocity", "effort"))
REFERENCE = WantedTopic(
    "reference", "pidtsm_msgs/msg/JointReference", ("position", "velocity", "acceleration"), may_be_empty=True
)
STATE = WantedTopic(
    "controller/state",
    "pidtsm_msgs/msg/ControllerState",
    tuple(signal.name.lower() for signal in Signal),
    "compute_time",
    tuple(code.name.lower() for code in Status),
)
# Only the stamps of the next two are read, to count lost messages.
SENSORS = WantedTopic("joint_states", _JOINT_STATE)
COMMANDS = WantedTopic("joint_commands", _JOINT_STATE)
DIAGNOSTICS = WantedTopic("diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
MEASURED = WantedTopic(SENSORS.name, _JOINT_STATE, ("position", "velocity", "effort"), optional=("velocity", "effort"))
"""The joint states of a bag without ground truth."""
COMMANDED = WantedTopic(COMMANDS.name, _JOINT_STATE, ("effort",))
"""The commands of a bag without ground truth or without controller state."""


def find_topics(connections: Sequence[Connection]) -> dict[WantedTopic, list[Connection]]:
    """Find the topics of a run, by type and last part of the name; those of which values are needed have messages.

    A topic has one connection per file of the bag. If there is no ground truth, the joint states take its place.

    Returns:
        The connections of each topic: of `TRUTH`, `SENSORS` and `COMMANDS`, or, where their values are needed, of
        `MEASURED` and `COMMANDED`; of `REFERENCE`; and of `STATE` and `DIAGNOSTICS`, if they are in the bag.

    Raises:
        RecordingError: the motion of the arm or the reference is missing, or a topic is ambiguous.
    """
    wanted = {topic: _find(topic, connections) for topic in (TRUTH, REFERENCE, STATE, SENSORS, COMMANDS, DIAGNOSTICS)}
    filled = {topic for topic, each in wanted.items() if any(connection.msgcount for connection in each)}
    # All messages of a topic that is only counted may be lost.
    found = {topic: each for topic, each in wanted.items() if topic in filled or (each and not topic.fields)}
    if TRUTH not in found and SENSORS in filled:
        found = {MEASURED: found.pop(SENSORS), **found}
    if COMMANDS in filled and not {TRUTH, STATE} <= found.keys():
        found[COMMANDED] = found.pop(COMMANDS)
    for topic, each in found.items():
        if topic.fields:
            _require_one_robot(topic, [connection for connection in each if connection.msgcount])
    lacking = [] if REFERENCE in found else [REFERENCE]
    if not {TRUTH, MEASURED} & found.keys():
        lacking.insert(0, TRUTH if not wanted[SENSORS] else SENSORS)
    for topic in lacking:
        if wanted[topic]:
            raise RecordingError(f"no messages on {wanted[topic][0].topic}: was its node running?")
    if lacking:
        texts = [f"{topic.name} ({topic.msgtype})" for topic in lacking]
        present = sorted({f"{c.topic} ({c.msgtype})" for c in connections})
        raise RecordingError(f"the bag lacks {', '.join(texts)}; it has {', '.join(present)}")
    return found


def connections_with_messages(topic: WantedTopic, connections: Sequence[Connection]) -> list[Connection]:
    """The connections of a topic in any namespace that have messages.

    Raises:
        RecordingError: there are two topics of that name.
    """
    found = [connection for connection in _find(topic, connections) if connection.msgcount]
    _require_one_robot(topic, found)
    return found


def _find(topic: WantedTopic, connections: Sequence[Connection]) -> list[Connection]:
    """The connections of a topic in any namespace."""
    last = topic.name.rpartition("/")[2]
    return [c for c in connections if c.msgtype == topic.msgtype and c.topic.rpartition("/")[2] == last]


def _require_one_robot(topic: WantedTopic, connections: Sequence[Connection]) -> None:
    names = sorted({connection.topic for connection in connections})
    if len(names) > 1:
        raise RecordingError(f"more than one {topic.name}: {', '.join(names)}; record one robot per bag")
