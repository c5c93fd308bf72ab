"""A bag as one MCAP file that Foxglove and RViz play as it is: the recorded topics, description and transforms."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from pidtsm_core.errors import UsageError
from pidtsm_core.robots import DESCRIPTION
from pidtsm_core.timing import NANOSECONDS
from pidtsm_experiments.bags.columns import BagMessages
from pidtsm_experiments.bags.errors import RecordingError, damaged
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.metadata import METADATA_KEY, run_metadata, stored_text
from pidtsm_experiments.bags.reader import open_bag
from pidtsm_experiments.bags.recovery import Readable, readable
from pidtsm_experiments.bags.topics import MEASURED, REFERENCE, TRUTH, WantedTopic, connections_with_messages
from pidtsm_experiments.export.arm import GHOST, drawn_arm
from pidtsm_experiments.export.markers import MARKERS, Skeleton
from pidtsm_experiments.export.mcap_file import McapFile, quality
from pidtsm_experiments.export.transforms import TRANSFORMS, Frames
from pidtsm_ros.cdr import stamps_of

RATE = 100.0
"""Transforms a second of each arm."""
_MOVING, _FIXED, _DESCRIPTION, _MARKERS = "/tf", "/tf_static", "/robot_description", "/visualization/markers"
_TEXT = "std_msgs/msg/String"
_EARLY = 1.01
"""Messages of a clock that is a hundredth early are due, too."""

Advance = Callable[[int, int], None]
"""Called now and then with the number of messages that are copied, and of all."""


@dataclass(frozen=True)
class Played:
    """What the file contains.

    Attributes:
        messages: number of the recorded messages.
        moments: number of times with transforms, of both arms together.
        source: topic of the positions.
        ghost: whether the reference is there, too.
        described: whether there is a description for viewers; an MJCF is none.
        flaws: signs that the bag was not finished; empty if it was.
    """

    messages: int
    moments: int
    source: str
    ghost: bool
    described: bool
    flaws: Sequence[str]


def write_foxglove(
    bag: Path, robot: Mapping[str, object] | None, stream: BinaryIO, advance: Advance = lambda *_: None
) -> Played:
    """Write the file.

    Args:
        bag: rosbag2 folder (MCAP or SQLite), or one file; a bag that was not finished is copied as far as possible.
        robot: parameters of the arm; None: those in the bag, or its ``robot_description``.
        stream: to write to; it must know its position.
        advance: shows the progress.

    Raises:
        RecordingError: the bag cannot be read, or has no positions.
        UsageError: the arm is not known, or is another one.
        OSError: writing failed.
    """
    try:
        with readable(bag) as whole, closing(open_bag(bag, whole)) as reader:
            return _Playable(bag, whole, reader, robot).write(stream, advance)
    except (OSError, UsageError):
        raise
    except RecordingError as error:
        raise RecordingError(f"{bag}: {error}") from error.__cause__
    except Exception as error:  # Damaged files cause many kinds of exceptions, rosbags' own and Python's.
        raise RecordingError(f"{bag}: {damaged('not a whole bag', error)}") from error


class _Playable:
    """A bag that is open, and the arm in it."""

    def __init__(self, bag: Path, whole: Readable, reader: AnyReader, robot: Mapping[str, object] | None) -> None:
        self._reader, self._messages = reader, BagMessages(reader)
        self._about, self._flaws = stored_text(bag, whole), whole.flaws
        self._motion = self._source()
        settings = run_metadata(bag, whole).robot if robot is None else robot
        self._arm = drawn_arm(settings or self._recorded_description())
        self._check_joints()
        self._clock, self._draws = _Clock(), True
        known = self._known_frames()
        self._frames = {self._motion: Frames(self._arm, "", known)}
        self._skeletons = {self._motion: Skeleton(self._arm, ghost=False)}
        if connections_with_messages(REFERENCE, reader.connections):
            self._frames[REFERENCE] = Frames(self._arm, f"{GHOST}/", known)
            self._skeletons[REFERENCE] = Skeleton(self._arm, ghost=True)

    def write(self, stream: BinaryIO, advance: Advance) -> Played:
        """Write the file; see `write_foxglove`."""
        reader, file = self._reader, McapFile(stream)
        if self._about:
            file.add_record(METADATA_KEY, {METADATA_KEY: self._about})
        for connection in reader.connections:
            file.add_recorded(connection, reader.typestore)
        described = self._begin(file)
        sources = {
            connection.topic: wanted
            for wanted in self._frames
            for connection in connections_with_messages(wanted, reader.connections)
        }
        for count, (connection, time, data) in enumerate(reader.messages()):
            file.write(connection.topic, time, data)
            wanted = sources.get(connection.topic)
            if wanted and self._clock.is_due(wanted, stamp := int(stamps_of([data])[0])):
                self._add_transforms(file, wanted, time, data, stamp)
            if count % 500 == 0:
                advance(count, reader.message_count)
        file.finish()
        source = next(topic for topic, wanted in sources.items() if wanted is self._motion)
        return Played(
            reader.message_count, self._clock.moments, source, REFERENCE in self._frames, described, self._flaws
        )

    def _begin(self, file: McapFile) -> bool:
        """Write what does not change; returns whether viewers have a description."""
        recorded = {connection.topic for connection in self._reader.connections}
        self._draws = _MARKERS not in recorded
        for topic, kind, offered in (
            (_DESCRIPTION, _TEXT, quality(1, kept=True)),
            (_FIXED, TRANSFORMS, quality(1, kept=True)),
            (_MOVING, TRANSFORMS, quality(100)),
            (_MARKERS, MARKERS, quality(1)),
        ):
            if topic not in recorded:
                file.add_topic(topic, kind, [offered])
        store, start = typestore(), self._reader.start_time
        urdf = self._arm.description.urdf
        if urdf and _DESCRIPTION not in recorded:
            file.write(_DESCRIPTION, start, _serialized(store.types[_TEXT](urdf)))
        if fixed := [each for frames in self._frames.values() for each in frames.fixed().transforms]:
            file.write(_FIXED, start, _serialized(store.types[TRANSFORMS](fixed)))
        return bool(urdf) or _DESCRIPTION in recorded

    def _add_transforms(self, file: McapFile, wanted: WantedTopic, time: int, data: bytes, stamp: int) -> None:
        message = self._messages.parse(data, wanted)
        q = self._arm.positions(message.name, message.position)
        if q is None:  # Drives that have not started report no positions, and a reference that is lost none.
            return
        moving = self._frames[wanted].moving(q, stamp)
        if moving.transforms:
            file.write(_MOVING, time, _serialized(moving))
        if self._draws:
            file.write(_MARKERS, time, _serialized(self._skeletons[wanted].markers(q, stamp)))
        self._clock.note(wanted, stamp)

    def _source(self) -> WantedTopic:
        """The topic of the positions: what the arm did, else what was measured."""
        for wanted in (TRUTH, MEASURED):
            if connections_with_messages(wanted, self._reader.connections):
                return wanted
        present = sorted({f"{c.topic} ({c.msgtype})" for c in self._reader.connections if c.msgcount})
        names = f"{TRUTH.name} or {MEASURED.name} ({TRUTH.msgtype})"
        raise RecordingError(f"no positions: the bag has no messages {names}; it has {', '.join(present)}")

    def _first(self, wanted: WantedTopic, connections: Sequence[Connection]) -> Any:
        _, data = next(self._messages.serialized(connections))
        return self._messages.parse(data, wanted)

    def _recorded_description(self) -> Mapping[str, object]:
        """Parameters of the arm that the bag's own ``robot_description`` describes; none: it has none."""
        wanted = WantedTopic(_DESCRIPTION, _TEXT)
        found = [c for c in self._reader.connections if c.topic == _DESCRIPTION and c.msgtype == _TEXT and c.msgcount]
        return {DESCRIPTION.name: self._first(wanted, found).data} if found else {}

    def _check_joints(self) -> None:
        """Raise UsageError if the recorded joints are not those of the arm."""
        names = self._first(self._motion, connections_with_messages(self._motion, self._reader.connections)).name
        if lacking := [joint for joint in self._arm.joints if joint not in names]:
            recorded = ", ".join(names) or "no joint"
            raise UsageError(
                f"{self._motion.name} has {recorded}, and not {', '.join(lacking)} of the arm; name the recorded arm "
                "with --robot, and its joints that move with --joints"
            )

    def _known_frames(self) -> set[str]:
        """Names of the frames that were recorded."""
        topics = (_MOVING, _FIXED)
        found = [c for c in self._reader.connections if c.topic in topics and c.msgtype == TRANSFORMS and c.msgcount]
        if not found:
            return set()
        kind = WantedTopic(_MOVING, TRANSFORMS)
        messages = (self._messages.parse(data, kind) for _, data in self._messages.serialized(found))
        return {transform.child_frame_id for message in messages for transform in message.transforms}


class _Clock:
    """Which stamps get transforms: at most `RATE` a second of each arm."""

    def __init__(self) -> None:
        self._last: dict[WantedTopic, int] = {}
        self.moments = 0

    def is_due(self, topic: WantedTopic, stamp: int) -> bool:
        last = self._last.get(topic)
        return last is None or _EARLY * abs(stamp - last) >= NANOSECONDS / RATE

    def note(self, topic: WantedTopic, stamp: int) -> None:
        self._last[topic] = stamp
        self.moments += 1


def _serialized(message: Any) -> bytes:
    return bytes(typestore().serialize_cdr(message, message.__msgtype__))
