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
        required: whether a recording needs the topic.
    """

    name: str
    msgtype: str
    fields: tuple[str, ...] = ()
    scalar: str = ""
    codes: tuple[str, ...] = ()
    may_be_empty: bool = False
    required: bool = True


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
SENSORS = WantedTopic("joint_states", _JOINT_STATE, required=False)
COMMANDS = WantedTopic("joint_commands", _JOINT_STATE, required=False)
DIAGNOSTICS = WantedTopic("diagnostics", "diagnostic_msgs/msg/DiagnosticArray", required=False)
_TOPICS = (TRUTH, REFERENCE, STATE, SENSORS, COMMANDS, DIAGNOSTICS)


def find_topics(connections: Sequence[Connection]) -> dict[WantedTopic, list[Connection]]:
    """Find the connections of each topic of a run, by type and last part of the name.

    A topic has one connection per file of the bag.

    Raises:
        RecordingError: a required topic is missing, ambiguous, or has no messages.
    """
    connections_of: dict[WantedTopic, list[Connection]] = {}
    for topic in _TOPICS:
        last = topic.name.rpartition("/")[2]
        matches = [c for c in connections if c.msgtype == topic.msgtype and c.topic.rpartition("/")[2] == last]
        names = sorted({c.topic for c in matches})
        if topic.required and len(names) > 1:
            raise RecordingError(f"more than one {topic.name}: {', '.join(names)}; record one robot per bag")
        if matches:
            connections_of[topic] = matches
    required = [topic for topic in _TOPICS if topic.required]
    if lacking := [f"{topic.name} ({topic.msgtype})" for topic in required if topic not in connections_of]:
        present = sorted({f"{c.topic} ({c.msgtype})" for c in connections})
        raise RecordingError(f"the bag lacks {', '.join(lacking)}; it has {', '.join(present)}")
    for topic in required:
        if not any(connection.msgcount for connection in connections_of[topic]):
            raise RecordingError(f"no messages on {connections_of[topic][0].topic}: was its node running?")
    return connections_of
