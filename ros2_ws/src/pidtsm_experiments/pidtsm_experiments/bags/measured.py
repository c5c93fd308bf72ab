"""The motion of a real arm, whose bag has no ground truth: from its joint states and commands."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Stamps
from pidtsm_experiments.bags.columns import Columns
from pidtsm_experiments.bags.errors import RecordingError
from pidtsm_experiments.bags.topics import COMMANDED, MEASURED, STATE, WantedTopic

_POSITION, _VELOCITY, _EFFORT = range(3)  # rows of MEASURED


def measured_motion(columns: Mapping[WantedTopic, Columns]) -> tuple[Columns, str]:
    """What takes the place of the ground truth.

    Velocities that the arm does not report are central differences of the positions. Efforts that it does not report
    are those commanded. Like in the ground truth, an effort is that applied from its stamp on. Joint states before the
    first in which everything has a value are left out.

    Args:
        columns: columns of every topic in the bag; that of the joint states is `MEASURED`.

    Returns:
        The joint states, completed, and a description of what was used.

    Raises:
        RecordingError: a velocity or effort is not finite although those before were.
    """
    states = columns[MEASURED]
    reported = [i for i in states.kept if i != _POSITION and np.isfinite(states.values[i]).all(axis=1).any()]
    start = max((reported_from(states, i) for i in reported), default=0)
    motion = states.at(np.arange(start, states.stamps.size))
    position, velocity, effort = motion.values
    if _VELOCITY in states.kept and _VELOCITY not in reported:
        seconds = (motion.stamps - motion.stamps[0]) / 1e9
        velocity[:] = np.gradient(position, seconds, axis=0) if len(position) > 1 else 0.0
    of_others = ""
    if _EFFORT in reported:
        effort[:-1] = effort[1:].copy()  # Reported at a stamp is what was applied before it.
    else:
        effort[:], of_others = _commanded(columns, motion.stamps)
    return motion, f"{MEASURED.name} (measured){of_others}, no ground truth in the bag"


def reported_from(states: Columns, field: int) -> int:
    """Index of the first message with values in an optional field.

    Raises:
        RecordingError: a later one does not have them.
    """
    finite = np.isfinite(states.values[field]).all(axis=1)
    first = int(finite.argmax())
    if not finite[first:].all():
        stamp = states.stamps[first + int(finite[first:].argmin())]
        name = states.topic.fields[field]
        raise RecordingError(f"{states.topic.name} has {name}s that are missing or not finite, first at {stamp} ns")
    return first


def _commanded(columns: Mapping[WantedTopic, Columns], stamps: Stamps) -> tuple[Array | float, str]:
    """The effort commanded last at each of these stamps, shape (stamps, joints), 0 before the first; and its topic."""
    for topic in (COMMANDED, STATE):
        if topic in columns:
            commands = columns[topic]
            return (
                held(commands.values[topic.fields.index("effort")], commands.stamps, stamps),
                f", efforts as commanded ({topic.name})",
            )
    return 0.0, ", efforts unknown"


def held(values: Array, known: Stamps, stamps: Stamps) -> Array:
    """The latest values at each of these stamps, shape (stamps, joints); 0 before the first.

    Args:
        values: shape (known, joints).
        known: their stamps, ns, increasing, shape (known,).
        stamps: ns, shape (stamps,).
    """
    rows: NDArray[np.intp] = np.searchsorted(known, stamps, side="right") - 1
    result = values[np.maximum(rows, 0)]
    result[rows < 0] = 0.0
    return result
