"""A recorded run as arrays: reads a bag and aligns its topics by header stamp."""

import json
import os
import struct
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from pidtsm_core.parameters import Array
from pidtsm_core.recording import Codes, Recording, Stamps
from pidtsm_core.signals import Signal, Status
from pidtsm_experiments.bags.recovery import Readable, readable, stored_metadata
from pidtsm_experiments.bags.reference_gaps import KnownMotion, interpolated, known_motion, near
from pidtsm_experiments.bags.rejections import rejections

METADATA_KEY = "pidtsm"
"""Key of the recorder's JSON text in the bag's custom data."""

_JOINT_STATE = "sensor_msgs/msg/JointState"
_OWN_MESSAGES = ("JointReference", "ControllerState")
_SIGNALS = tuple(signal.name.lower() for signal in Signal)
_CODES = tuple(code.name.lower() for code in Status)
_BLOCK = 2048  # messages decoded at once: enough for NumPy, little enough for memory and for mixed layouts
_STAMP = slice(4, 12)  # where a CDR message that starts with std_msgs/Header has its stamp


class RecordingError(ValueError):
    """A bag cannot be read, or is not of a run; the message says why and what to do."""


class UnfinishedBag(UserWarning):
    """What was read comes from a bag that was never finished; the message says what is missing."""


@dataclass(frozen=True)
class _Topic:
    """A topic to look for, whatever namespace it has.

    Attributes:
        name: as in `Recording.lost`; its last part must be that of the topic.
        msgtype: its type.
        fields: one array a joint that are read.
        scalar: a float64 that is read and is the last field of the message, empty where there is none.
        codes: whole numbers that are read; 0 where a message of an older version has none.
        may_be_empty: a message without joints says that there is nothing to say.
        required: without it there is no recording.
    """

    name: str
    msgtype: str
    fields: tuple[str, ...] = ()
    scalar: str = ""
    codes: tuple[str, ...] = ()
    may_be_empty: bool = False
    required: bool = True


_TRUTH = _Topic("simulator/ground_truth", _JOINT_STATE, ("position", "velocity", "effort"))
_REFERENCE = _Topic(
    "reference", "pidtsm_msgs/msg/JointReference", ("position", "velocity", "acceleration"), may_be_empty=True
)
_STATE = _Topic("controller/state", "pidtsm_msgs/msg/ControllerState", _SIGNALS, "compute_time", _CODES)
# Nothing is taken from the next two but whether they are complete.
_SENSORS = _Topic("joint_states", _JOINT_STATE, required=False)
_COMMANDS = _Topic("joint_commands", _JOINT_STATE, required=False)
_DIAGNOSTICS = _Topic("diagnostics", "diagnostic_msgs/msg/DiagnosticArray", required=False)
_TOPICS = (_TRUTH, _REFERENCE, _STATE, _SENSORS, _COMMANDS, _DIAGNOSTICS)


def typestore() -> Typestore:
    """Types of ROS 2 Jazzy and of pidtsm_msgs.

    Raises:
        RecordingError: the .msg files of pidtsm_msgs are neither installed nor beside this package.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in _OWN_MESSAGES:
        store.register(get_types_from_msg(_definition(name), f"pidtsm_msgs/msg/{name}"))
    return store


def _definition(name: str) -> str:
    shares = [Path(p, "share") for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    for root in (*shares, Path(__file__).resolve().parents[2]):
        file = root / "pidtsm_msgs" / "msg" / f"{name}.msg"
        if file.is_file():
            return file.read_text(encoding="utf-8")
    raise RecordingError(f"{name}.msg of pidtsm_msgs is not found: source the workspace")


METRICS_ONLY = frozenset(("position", "effort", "saturated", "adaptive_gain"))
"""What the metrics are made of, by the names of the messages' fields."""


def read_recording(path: Path, only: frozenset[str] | None = None) -> Recording:
    """Read a run from a bag.

    Messages belong together when their header stamps are equal. A sample is a stamp at which there are ground truth
    and controller state, or ground truth alone: that is a measurement that never left its sensor, and there the
    controller's signals are the last ones, 0 before the first. Where a sample has no reference, it is computed from the
    trajectory's parameters that the bag has; where that gives another motion than what was recorded, it is interpolated
    over a short time, and samples beyond that are left out. Joints are matched by name. Of a bag whose recorder was
    killed, or had no more space, what there is is read, with the warning `UnfinishedBag`.

    Args:
        path: rosbag2 folder (MCAP or SQLite), or one .mcap or .db3 file.
        only: names of the messages' fields to keep; the others are 0 and take no memory. None keeps all.

    Raises:
        RecordingError: not a bag, no messages, a topic or joint missing, nothing with equal stamps, or
            values that are not finite.
    """
    try:
        return _read(path, only)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error.__cause__
    except Exception as error:  # Broken files are met with many exceptions, rosbags' own and Python's.
        raise RecordingError(f"{path}: {_damaged('not a whole bag', error)}") from error


def _read(path: Path, only: frozenset[str] | None) -> Recording:
    with readable(path) as bag, closing(_open(path, bag)) as reader:
        found = _find_topics(reader.connections)
        said, trajectory, namespace = _metadata(path, bag)
        joints, columns, rejected = _read_topics(reader, found, only, namespace)
    if bag.flaws:
        warnings.warn(UnfinishedBag(f"{path}: {_missing(bag, columns)}"), stacklevel=3)
    moments = columns[_TRUTH].stamps
    needed = {topic: columns[topic] for topic in (_TRUTH, _REFERENCE, _STATE)}
    if reduce(_common, (column.stamps for column in needed.values())).size == 0:
        raise RecordingError(
            f"no stamp is in all of {', '.join(t.name for t in needed)}; each must carry the stamp of the joint state "
            "that it belongs to"
        )
    answers = {topic: column for topic, column in columns.items() if topic is not _TRUTH}
    unsent, known = np.empty(0, dtype=np.int64), None
    if columns[_REFERENCE].filled.all() and all(np.array_equal(moments, column.stamps) for column in needed.values()):
        stamps, truth, reference, state = moments, *needed.values()
    else:
        unsent = np.setdiff1d(moments, np.concatenate([column.stamps for column in answers.values()]))
        stamps, reference, known = _referred(moments, unsent, columns, trajectory, joints)
        unsent = np.intersect1d(unsent, stamps, assume_unique=True)
        truth = _rows(columns[_TRUTH], np.searchsorted(moments, stamps), _TRUTH)
        state = _held(columns[_STATE], stamps)
    return Recording(
        joints=joints,
        time=(stamps - moments[0]) / 1e9,
        stamps_ns=stamps,
        position=truth.values[0],
        velocity=truth.values[1],
        effort=truth.values[2],
        reference=reference.values.swapaxes(0, 1),
        signals=state.values.swapaxes(0, 1),
        status=state.codes,
        compute_time=state.scalars,
        **said,
        lost=_lost(moments, unsent, answers, known),
        rejected=rejected,
    )


def _referred(
    moments: Stamps, unsent: Stamps, columns: Mapping[_Topic, "_Columns"], trajectory: object, joints: Sequence[str]
) -> tuple[Stamps, "_Columns", KnownMotion | None]:
    """The samples of a recording that is not complete, the reference of each, and the motion if it is known.

    Args:
        moments: stamps of the ground truth.
        unsent: those that nobody answers.
        columns: of every topic.
        trajectory: parameters, see `known_motion`.
        joints: names.

    Raises:
        RecordingError: there is no sample.
    """
    reference = columns[_REFERENCE]
    start = int(reference.stamps[0])
    reference = _rows(reference, np.flatnonzero(reference.filled), _REFERENCE)
    answered = _common(moments, columns[_STATE].stamps)
    lacking = np.setdiff1d(np.union1d(answered, unsent), reference.stamps, assume_unique=True)
    known = None
    if lacking.size:
        known = known_motion(trajectory, joints, start, reference.stamps, reference.values, lacking)
    if known is None:
        lacking = near(reference.stamps, lacking)
    spoken = _common(answered, reference.stamps)
    stamps = np.union1d(spoken, lacking)
    if stamps.size == 0:
        raise RecordingError("no controller state has a reference, and nothing says what the reference was")
    taken = _columns(_REFERENCE, stamps.size, len(joints), reference.kept)
    taken.stamps[:] = stamps
    taken.values[:, np.searchsorted(stamps, spoken)] = reference.values[:, np.searchsorted(reference.stamps, spoken)]
    if lacking.size:
        filled = known.at(lacking) if known else interpolated(reference.stamps, reference.values, lacking)
        taken.values[:, np.searchsorted(stamps, lacking)] = filled
    return stamps, taken, known


def _lost(
    moments: Stamps, unsent: Stamps, answers: Mapping[_Topic, "_Columns"], known: KnownMotion | None
) -> dict[str, int]:
    """How many stamps of the ground truth lack a partner, by topic."""
    sent = np.setdiff1d(moments, unsent, assume_unique=True)
    lost = {}
    for topic, column in answers.items():
        wanted = sent[~known.stays_out(sent)] if known and topic is _REFERENCE else sent
        lost[topic.name] = wanted.size - _common(wanted, column.stamps).size
    return lost


def _held(state: "_Columns", stamps: Stamps) -> "_Columns":
    """What the controller said last at any stamps; 0 before it said anything."""
    rows = np.searchsorted(state.stamps, stamps, side="right") - 1
    held = _rows(state, np.maximum(rows, 0), _STATE)
    held.stamps[:] = stamps
    held.codes[rows < 0] = 0
    for i in state.kept:
        held.values[i, rows < 0] = 0.0
    return held


def _common(stamps: Stamps, others: Stamps) -> Stamps:
    """Stamps that are in both; nearly always they are the same."""
    return stamps if np.array_equal(stamps, others) else np.intersect1d(stamps, others, assume_unique=True)


@dataclass(frozen=True)
class _Columns:
    """One topic as arrays, sorted by stamp, each stamp once.

    Attributes:
        stamps: ns, shape (messages,).
        values: shape (fields, messages, joints), order of the topic's fields. Memory that nobody writes to, of a field
            that is not kept, is only promised by the operating system.
        scalars: shape (messages,).
        codes: shape (messages, codes), order of the topic's codes.
        filled: whether a message has joints and values, shape (messages,).
        kept: numbers of the fields that are kept.
    """

    stamps: Stamps
    values: Array
    scalars: Array
    codes: Codes
    filled: NDArray[np.bool_]
    kept: Sequence[int]

    def rows(self, start: int, stop: int) -> "_Columns":
        """Views of some messages."""
        return _Columns(
            self.stamps[start:stop],
            self.values[:, start:stop],
            self.scalars[start:stop],
            self.codes[start:stop],
            self.filled[start:stop],
            self.kept,
        )


def _columns(topic: _Topic, messages: int, joints: int, kept: Sequence[int]) -> _Columns:
    return _Columns(
        np.zeros(messages, dtype=np.int64),
        np.zeros((len(topic.fields), messages, joints)),
        np.zeros(messages if topic.scalar else 0),
        np.zeros((messages, len(topic.codes)), dtype=np.uint8),
        np.ones(messages, dtype=np.bool_),
        kept,
    )


def _missing(bag: Readable, columns: Mapping[_Topic, "_Columns"]) -> str:
    """What is missing in an unfinished bag, by the stamps."""
    first = columns[_TRUTH].stamps[0]
    last = {topic.name: (column.stamps[-1] - first) / 1e9 for topic, column in columns.items() if column.stamps.size}
    end = max(last.values())
    earlier = [f"{name} at {time:.3f} s" for name, time in last.items() if time < end]
    text = f"the bag was not finished ({'; '.join(bag.flaws)}). Everything after {end:.3f} s is missing"
    return f"{text}; earlier end {', '.join(earlier)}" if earlier else text


def _open(path: Path, bag: Readable) -> AnyReader:
    if not path.exists():
        raise RecordingError("there is no such file or folder")
    if path.is_dir() and not bag.flaws and not (path / "metadata.yaml").exists():
        raise RecordingError("not a bag: no metadata.yaml, and no .mcap or .db3 file")
    if not bag.files:
        raise RecordingError(f"the bag was not finished, and nothing in it can be read: {'; '.join(bag.flaws)}")
    reader = AnyReader(bag.files, default_typestore=typestore())
    reader.open()
    if reader.message_count == 0:
        reader.close()
        if bag.flaws:
            raise RecordingError(f"the bag ended before its first message was written: {'; '.join(bag.flaws)}")
        raise RecordingError("no messages: was anything running, with the same ROS_DOMAIN_ID, when it was recorded?")
    return reader


def _damaged(what: str, error: Exception) -> RecordingError:
    said = str(error) or type(error).__name__
    return RecordingError(f"{what}: {said} (`mcap recover FILE.mcap -o SAVED.mcap` saves the rest of an MCAP file)")


def _find_topics(connections: Sequence[Connection]) -> dict[_Topic, list[Connection]]:
    """Connections of each topic, by type and last part of the name."""
    found: dict[_Topic, list[Connection]] = {}
    for topic in _TOPICS:
        last = topic.name.rpartition("/")[2]
        matches = [c for c in connections if c.msgtype == topic.msgtype and c.topic.rpartition("/")[2] == last]
        names = sorted({c.topic for c in matches})
        if topic.required and len(names) > 1:
            raise RecordingError(f"more than one {topic.name}: {', '.join(names)}; record one robot a bag")
        if matches:
            found[topic] = matches
    lacking = [f"{topic.name} ({topic.msgtype})" for topic in _TOPICS if topic.required and topic not in found]
    if lacking:
        has = sorted({f"{c.topic} ({c.msgtype})" for c in connections})
        raise RecordingError(f"the bag lacks {', '.join(lacking)}; it has {', '.join(has)}")
    for topic, matches in found.items():
        if topic.required and not any(connection.msgcount for connection in matches):
            raise RecordingError(f"no messages on {matches[0].topic}: was its node running?")
    return found


def _messages(reader: AnyReader, connections: Sequence[Connection]) -> Iterator[tuple[str, bytes]]:
    """Topic and payload of every message of `connections`."""
    try:
        for connection, _, payload in reader.messages(connections):
            yield connection.topic, payload
    except Exception as error:  # as in read_recording
        raise _damaged("the messages cannot be read", error) from error


def _read_topics(
    reader: AnyReader, found: Mapping[_Topic, list[Connection]], only: frozenset[str] | None, namespace: str
) -> tuple[tuple[str, ...], dict[_Topic, _Columns], dict[str, int] | None]:
    """Joints of the ground truth, every topic of samples, and what the nodes rejected.

    Args:
        reader: of the bag.
        found: topics to read.
        only: fields to keep; all where None.
        namespace: of the nodes, where the names of topics do not have it.
    """
    found = dict(found)
    diagnostics = found.pop(_DIAGNOSTICS, [])
    _, first = next(_messages(reader, found[_TRUTH]), ("", b""))
    joints = tuple(_parse(reader, first, _TRUTH).name)
    topic_of = {connection.topic: topic for topic, connections in found.items() for connection in connections}
    pending: dict[_Topic, list[bytes]] = {topic: [] for topic in found}
    done = dict.fromkeys(found, 0)
    columns = {
        topic: _columns(
            topic,
            sum(connection.msgcount for connection in connections),
            len(joints),
            # The reference may have to be interpolated.
            [i for i, name in enumerate(topic.fields) if only is None or name in only or topic is _REFERENCE],
        )
        for topic, connections in found.items()
    }

    def decode(topic: _Topic) -> None:
        start, stop = done[topic], done[topic] + len(pending[topic])
        _decode(pending[topic], topic, joints, reader, columns[topic].rows(start, stop))
        pending[topic], done[topic] = [], stop

    reports = []
    for name, payload in _messages(reader, [c for some in (*found.values(), diagnostics) for c in some]):
        topic = topic_of.get(name)
        if topic is None:
            reports.append(_parse(reader, payload, _DIAGNOSTICS))
            continue
        pending[topic].append(payload)
        if len(pending[topic]) == _BLOCK:
            decode(topic)
    for topic in found:
        decode(topic)
        if (missing := columns[topic].stamps.size - done[topic]) > 0:
            raise _damaged(f"{missing} messages of {topic.name} cannot be read", ValueError("the file has a hole"))
    rejected = rejections(reports, namespace or found[_TRUTH][0].topic.removesuffix(_TRUTH.name).strip("/"))
    return joints, {topic: _sorted(columns[topic].rows(0, done[topic]), topic) for topic in found}, rejected


def _sorted(columns: _Columns, topic: _Topic) -> _Columns:
    if (np.diff(columns.stamps) > 0).all():
        return columns
    return _rows(columns, np.unique(columns.stamps, return_index=True)[1], topic)


def _rows(columns: _Columns, rows: NDArray[np.intp], topic: _Topic) -> _Columns:
    taken = _columns(topic, rows.size, columns.values.shape[2], columns.kept)
    taken.stamps[:] = columns.stamps[rows]
    taken.codes[:] = columns.codes[rows]
    taken.filled[:] = columns.filled[rows]
    for i in columns.kept:
        taken.values[i] = columns.values[i, rows]
    if topic.scalar:
        taken.scalars[:] = columns.scalars[rows]
    return taken


def _parse(reader: AnyReader, payload: bytes, topic: _Topic) -> Any:
    try:
        return reader.deserialize(payload, topic.msgtype)
    except Exception as error:  # as in read_recording
        raise _damaged(f"a message of {topic.name} cannot be read", error) from error


def _decode(
    payloads: Sequence[bytes], topic: _Topic, joints: Sequence[str], reader: AnyReader, columns: _Columns
) -> None:
    """Decode messages of one topic into `columns`.

    Objects would take most of the time of reading a bag. But the payloads of a topic nearly always differ in
    nothing but their numbers, so that what rosbags says about one tells where the numbers stand in all.
    """
    header = np.frombuffer(b"".join(payload[_STAMP] for payload in payloads), dtype=[("sec", "<i4"), ("ns", "<u4")])
    columns.stamps[:] = header["sec"] * np.int64(1_000_000_000) + header["ns"]
    if not topic.fields or not payloads:
        return
    lengths = np.array([len(payload) for payload in payloads])
    pending = np.arange(len(payloads))
    while pending.size:
        first = payloads[pending[0]]
        layout = _layout(first, topic, joints, reader)
        rows = pending[lengths[pending] == len(first)]
        table = np.frombuffer(b"".join([payloads[row] for row in rows]), np.uint8).reshape(rows.size, len(first))
        alike = (table[:, layout.fixed] == table[0, layout.fixed]).all(axis=1)
        rows = rows[alike]
        pending = np.setdiff1d(pending, rows, assume_unique=True)
        columns.codes[rows] = layout.codes
        columns.filled[rows] = layout.places.size > 0
        if not layout.places.size:
            continue
        numbers = table[alike].take(layout.places, axis=1).view("<f8")
        size = len(topic.fields) * len(joints)
        values = numbers[:, :size].reshape(rows.size, len(topic.fields), len(joints))
        for i in columns.kept:
            columns.values[i, rows] = values[:, i]
        if topic.scalar:
            columns.scalars[rows] = numbers[:, size]
    tables = [columns.values[i] for i in columns.kept] + ([columns.scalars[:, None]] if topic.scalar else [])
    for table in tables:
        finite = np.isfinite(table).all(axis=1)
        if not finite.all():
            stamp = columns.stamps[np.argmin(finite)]
            raise RecordingError(f"{topic.name} has values that are not finite, first at stamp {stamp} ns")


@dataclass(frozen=True)
class _Layout:
    """How messages are built that differ in nothing but stamp and numbers.

    Attributes:
        fixed: which bytes they share, shape (length,).
        places: of the bytes of the numbers that are read, in the order fields x joints, scalar; none where there is
            nothing in the message.
        codes: that the messages share, in the order of the topic's.
    """

    fixed: NDArray[np.bool_]
    places: NDArray[np.intp]
    codes: Sequence[int]


def _layout(payload: bytes, topic: _Topic, joints: Sequence[str], reader: AnyReader) -> _Layout:
    """How a message is built."""
    fixed = np.ones(len(payload), dtype=np.bool_)
    fixed[_STAMP] = False
    if topic.may_be_empty and (end := _end_of_empty(payload, 1 + len(topic.fields))):
        fixed[end:] = False
        return _Layout(fixed, np.empty(0, dtype=np.intp), ())
    message = _parse(reader, payload, topic)
    names = list(message.name)
    missing = [joint for joint in joints if joint not in names]
    if missing or not joints:
        raise RecordingError(f"{topic.name} lacks {', '.join(missing) or 'joint names'}; it has {names}")
    place: dict[str, int] = {}
    for name, value in vars(message).items():
        if isinstance(value, np.ndarray) and value.size:
            # rosbags gives arrays as views of the payload without its first bytes: their addresses tell their places.
            if not isinstance(value.base, bytes):
                raise RecordingError(f"{topic.name} is not little-endian CDR")
            body = np.frombuffer(value.base, np.uint8)
            place[name] = len(payload) - body.size + value.ctypes.data - body.ctypes.data
            fixed[place[name] : place[name] + value.nbytes] = False
    for name in topic.fields:
        size = np.size(getattr(message, name, ()))
        if size != len(names):
            raise RecordingError(f"{topic.name} has {size} values of {name} for {len(names)} joints")
    starts = [place[name] + 8 * names.index(joint) for name in topic.fields for joint in joints]
    if topic.scalar:
        starts.append(len(payload) - 8)
        # With the other float64 fields before it.
        # A message object has the constants of its definition too.
        names_in_order = [name for name, _ in reader.typestore.get_msgdef(topic.msgtype).fields]
        floats = [isinstance(getattr(message, name), float) for name in names_in_order]
        fixed[-8 * floats[::-1].index(False) :] = False
        if struct.pack("<d", getattr(message, topic.scalar, 0.0)) != payload[-8:]:
            raise RecordingError(f"{topic.name} does not end with {topic.scalar}: recorded with another pidtsm_msgs")
    return _Layout(fixed, np.add.outer(starts, np.arange(8)).ravel(), _codes(message, topic, names, joints))


def _end_of_empty(payload: bytes, sequences: int) -> int:
    """Length of a message of a header and so many sequences, if these are all empty, else 0.

    Fast CDR leaves bytes of any value behind such a message, which rosbags then takes for a damaged one.
    """
    frame = struct.Struct("<xB10xI")
    if len(payload) < frame.size:
        return 0
    little_endian, length = frame.unpack_from(payload)
    begin = (frame.size + length + 3) // 4 * 4
    end = begin + 4 * sequences
    return end if little_endian == 1 and payload[begin:end] == bytes(4 * sequences) else 0


def _codes(message: Any, topic: _Topic, names: Sequence[str], joints: Sequence[str]) -> list[int]:
    """The codes of a message; a joint that caused a fault counts in the order of the recording's joints."""
    codes = [int(getattr(message, name, 0)) for name in topic.codes]
    if topic is _STATE and codes[Status.FAULT_JOINT]:
        caused = names[codes[Status.FAULT_JOINT] - 1 : codes[Status.FAULT_JOINT]]
        codes[Status.FAULT_JOINT] = joints.index(caused[0]) + 1 if caused and caused[0] in joints else 0
    return codes


def _metadata(path: Path, bag: Readable) -> tuple[dict[str, Any], object, str]:
    """What the recorder says about the run, None where it says nothing, and the trajectory's parameters.

    Third, the namespace of the nodes where the names of topics lack it.
    """
    folder = path if path.is_dir() else path.parent
    custom: Mapping[str, str] = {}
    if (folder / "metadata.yaml").exists() and not bag.flaws:
        with Reader(folder) as reader:
            custom = reader.storage.metadata.custom or {}
    elif bag.files[0].suffix == ".mcap":
        custom = stored_metadata(bag.files[0], METADATA_KEY)
    try:
        said = json.loads(custom.get(METADATA_KEY, "{}"))
        event_time = said.get("event_time")
        return (
            {
                **{key: said.get(key) for key in ("scenario", "law", "clock")},
                "event_time": None if event_time is None else float(event_time),
            },
            said.get("trajectory"),
            str(said.get("namespace", "")),
        )
    except (AttributeError, TypeError, ValueError) as error:
        raise RecordingError(f"custom data {METADATA_KEY} is not what the recorder writes: {error}") from None
