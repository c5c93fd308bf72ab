"""Reads a recorded run from a bag and aligns its topics by header stamp."""

import warnings
from collections.abc import Mapping, Sequence
from contextlib import closing
from functools import reduce
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader

from pidtsm_core.recording import Recording, Stamps
from pidtsm_core.recording.outcome import GROUND_TRUTH
from pidtsm_experiments.bags.columns import Columns, read_columns
from pidtsm_experiments.bags.errors import RecordingError, UnfinishedBag, damaged
from pidtsm_experiments.bags.measured import held, measured_motion
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.metadata import run_metadata
from pidtsm_experiments.bags.recovery import Readable, readable
from pidtsm_experiments.bags.reference_gaps import KnownMotion, interpolated, known_motion, near
from pidtsm_experiments.bags.topics import COMMANDED, MEASURED, REFERENCE, STATE, TRUTH, WantedTopic, find_topics

METRICS_ONLY = frozenset(("position", "effort", "saturated", "adaptive_gain"))
"""Message fields needed for the metrics."""


def read_recording(path: Path, only: frozenset[str] | None = None) -> Recording:
    """Read a run from a bag.

    Messages with equal header stamps belong together. A sample is a stamp with both ground truth and controller state,
    or with ground truth alone if the measurement was lost at the sensor. In the latter case the controller's signals
    are the previous ones, 0 before the first. In the bag of a real arm, which has no ground truth, a sample is a joint
    state, see `measured_motion`; a bag without controller state has a sample for each stamp of the motion, and only the
    efforts of the controller's signals, from its commands.

    Missing references are computed from the trajectory's parameters in the bag. If that motion differs from the
    recorded one, the reference is interpolated over short gaps, and samples in longer gaps are omitted. Joints are
    matched by name. A bag whose recorder was killed or ran out of space is read as far as possible, with the warning
    `UnfinishedBag`.

    Args:
        path: rosbag2 folder (MCAP or SQLite), or one .mcap or .db3 file.
        only: names of the message fields to keep; the others are 0 and take no memory. None: keep all.

    Raises:
        RecordingError: not a bag, no messages, a missing topic or joint, no common stamps, or values that are not
            finite.
    """
    try:
        return _read(path, only)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error.__cause__
    except Exception as error:  # Damaged files cause many kinds of exceptions, rosbags' own and Python's.
        raise RecordingError(f"{path}: {damaged('not a whole bag', error)}") from error


def _read(path: Path, only: frozenset[str] | None) -> Recording:
    with readable(path) as bag, closing(open_bag(path, bag)) as reader:
        connections_of = find_topics(reader.connections)
        metadata = run_metadata(path, bag)
        joints, columns, reports = read_columns(reader, connections_of, only, metadata.namespace)
    if bag.flaws:
        warnings.warn(UnfinishedBag(f"{path}: {_missing(bag, columns)}"), stacklevel=3)
    true, source = (columns[TRUTH], GROUND_TRUTH) if TRUTH in columns else measured_motion(columns)
    moments = true.stamps
    needed = [columns[topic] for topic in (REFERENCE, STATE) if topic in columns]
    answers = {topic: column for topic, column in columns.items() if topic not in (TRUTH, MEASURED)}
    _require_common_stamps(true, needed)
    unsent, known = np.empty(0, dtype=np.int64), None
    if columns[REFERENCE].filled.all() and all(np.array_equal(moments, column.stamps) for column in needed):
        stamps, reference = moments, columns[REFERENCE]
    else:
        if TRUTH in columns:
            unsent = np.setdiff1d(moments, np.concatenate([column.stamps for column in answers.values()]))
        answered = columns[STATE].stamps if {TRUTH, STATE} <= columns.keys() else moments
        stamps, reference, known = _with_references(
            _common(moments, answered), unsent, columns[REFERENCE], metadata.trajectory, joints
        )
        unsent = np.intersect1d(unsent, stamps, assume_unique=True)
    truth = true if stamps is moments else true.at(np.searchsorted(moments, stamps))
    state = _held(columns[STATE], stamps) if STATE in columns else _without_state(columns, stamps, joints)
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
        compute_time=state.scalars if state.scalars.any() else np.empty(0),  # 0: not measured.
        scenario=metadata.scenario,
        law=metadata.law,
        clock=metadata.clock,
        event_time=metadata.event_time,
        lost=_lost(moments, unsent, answers, known),
        rejected=reports.rejected,
        found=reports.found,
        slides=tuple(joint in metadata.sliding for joint in joints),
        continuous=tuple(joint in metadata.continuous for joint in joints),
        robot=metadata.robot,
        truth=source,
        lacking=() if STATE in columns else (STATE.name,),
    )


def _require_common_stamps(true: Columns, needed: Sequence[Columns]) -> None:
    """Raise RecordingError if the messages of a run cannot be matched.

    References and commands of others may have stamps of their own; then they are interpolated or held.
    """
    others = needed if true.topic is TRUTH else [column for column in needed if column.topic is STATE]
    if reduce(_common, (column.stamps for column in (true, *others))).size == 0:
        names = ", ".join(column.topic.name for column in (true, *others))
        raise RecordingError(f"no stamp is in all of {names}; each message must have the stamp of its joint state")


def open_bag(path: Path, bag: Readable) -> AnyReader:
    """A reader of a bag that has messages.

    Raises:
        RecordingError: there are none.
    """
    if not path.exists():
        raise RecordingError("no such file or folder")
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


def _missing(bag: Readable, columns: Mapping[WantedTopic, Columns]) -> str:
    """Description of what is missing in an unfinished bag, from the stamps."""
    first = columns[TRUTH if TRUTH in columns else MEASURED].stamps[0]
    last = {topic.name: (column.stamps[-1] - first) / 1e9 for topic, column in columns.items() if column.stamps.size}
    end = max(last.values())
    earlier = [f"{name} at {time:.3f} s" for name, time in last.items() if time < end]
    text = f"the bag was not finished ({'; '.join(bag.flaws)}). Everything after {end:.3f} s is missing"
    return f"{text}; topics that end earlier: {', '.join(earlier)}" if earlier else text


def _with_references(
    answered: Stamps, unsent: Stamps, reference: Columns, trajectory: object, joints: Sequence[str]
) -> tuple[Stamps, Columns, KnownMotion | None]:
    """Samples of an incomplete recording, their references, and the motion if it is known.

    Args:
        answered: stamps of the motion that the controller answered, ns, shape (measurements,).
        unsent: those that no topic but the ground truth has, ns.
        reference: columns of the references.
        trajectory: parameters, see `known_motion`.
        joints: names.

    Returns:
        Stamps in ns, shape (samples,); one reference per sample; the motion, None if unknown.

    Raises:
        RecordingError: there are no samples.
    """
    start = int(reference.stamps[0])
    reference = reference.at(np.flatnonzero(reference.filled))
    lacking = np.setdiff1d(np.union1d(answered, unsent), reference.stamps, assume_unique=True)
    known = None
    if lacking.size:
        known = known_motion(trajectory, joints, start, reference.stamps, reference.values, lacking)
    if known is None:
        lacking = near(reference.stamps, lacking)
    recorded = _common(answered, reference.stamps)
    stamps = np.union1d(recorded, lacking)
    if stamps.size == 0:
        raise RecordingError("no sample has a reference, and the bag does not describe the reference motion")
    complete = Columns.blank(REFERENCE, stamps.size, len(joints), reference.kept)
    complete.stamps[:] = stamps
    rows = np.searchsorted(reference.stamps, recorded)
    complete.values[:, np.searchsorted(stamps, recorded)] = reference.values[:, rows]
    if lacking.size:
        values = known.at(lacking) if known else interpolated(reference.stamps, reference.values, lacking)
        complete.values[:, np.searchsorted(stamps, lacking)] = values
    return stamps, complete, known


def _lost(
    moments: Stamps, unsent: Stamps, answers: Mapping[WantedTopic, Columns], known: KnownMotion | None
) -> dict[str, int]:
    """Number of ground truth stamps without a matching message, by topic."""
    sent = np.setdiff1d(moments, unsent, assume_unique=True)
    lost = {}
    for topic, column in answers.items():
        if topic in (REFERENCE, COMMANDED) and _common(sent, column.stamps).size == 0:
            continue  # Its stamps are not those of the joint states.
        expected = sent[~known.stays_out(sent)] if known and topic is REFERENCE else sent
        lost[topic.name] = expected.size - _common(expected, column.stamps).size
    return lost


def _held(state: Columns, stamps: Stamps) -> Columns:
    """The latest controller state at each of these stamps; 0 before the first."""
    if np.array_equal(state.stamps, stamps):
        return state
    rows = np.searchsorted(state.stamps, stamps, side="right") - 1
    held = state.at(np.maximum(rows, 0))
    held.stamps[:] = stamps
    held.codes[rows < 0] = 0
    for i in state.kept:
        held.values[i, rows < 0] = 0.0
    return held


def _without_state(columns: Mapping[WantedTopic, Columns], stamps: Stamps, joints: Sequence[str]) -> Columns:
    """The signals of a controller that publishes commands alone; what it does not publish is 0."""
    effort = STATE.fields.index("effort")
    state = Columns.blank(STATE, stamps.size, len(joints), [effort])
    if commands := columns.get(COMMANDED):
        state.values[effort] = held(commands.values[0], commands.stamps, stamps)
    return state


def _common(stamps: Stamps, others: Stamps) -> Stamps:
    """Stamps that are in both; in nearly all cases they are equal."""
    return stamps if np.array_equal(stamps, others) else np.intersect1d(stamps, others, assume_unique=True)
