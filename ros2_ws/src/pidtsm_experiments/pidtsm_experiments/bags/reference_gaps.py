"""References that a bag lacks: computed as the trajectory does, or, where its motion is not known, interpolated."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.node_parameters import NODE_SCHEMAS
from pidtsm_core.parameters import Array, ParameterError, names, resolve
from pidtsm_core.recording import Stamps
from pidtsm_core.references import ReferenceMotion, reference_joints
from pidtsm_core.timing import seconds

LONGEST_GAP = 100_000_000
"""ns; a reference can be interpolated this far from a recorded one."""

_COMPARED = 200  # recorded references that a known motion must agree with


@dataclass(frozen=True)
class KnownMotion:
    """The motion that the trajectory publishes.

    Attributes:
        motion: the same as the trajectory's.
        places: indices of the recording's joints among the motion's, shape (joints,).
        start: stamp at which it began, ns.
    """

    motion: ReferenceMotion
    places: NDArray[np.intp]
    start: int

    def at(self, stamps: Stamps) -> Array:
        """q_d, q_d', q_d'' to the last bit as the trajectory computes them, rad and s, shape (3, stamps, joints)."""
        desired = np.zeros((3, self.motion.joints))
        values = np.empty((3, stamps.size, self.places.size))
        for k, elapsed in enumerate((stamps - self.start).tolist()):
            self.motion.evaluate(seconds(elapsed), desired)
            values[:, k] = desired[:, self.places]
        return values

    def stays_out(self, stamps: Stamps) -> NDArray[np.bool_]:
        """Whether the trajectory is to publish nothing at each of these stamps, shape (stamps,)."""
        elapsed = (stamps - self.start) / 1e9
        return (self.motion.config.dropout_begin <= elapsed) & (elapsed < self.motion.config.dropout_end)


def known_motion(
    parameters: object, joints: Sequence[str], start: int, stamps: Stamps, values: Array, lacking: Stamps
) -> KnownMotion | None:
    """The motion that a bag's parameters describe, None if it is not the recorded one.

    Another motion is recorded when somebody commands a trajectory, or changes a file.

    Args:
        parameters: of the trajectory, by name, as the bag has them; anything else gives None.
        joints: names, in the order of the recording.
        start: stamp of the first reference, with or without values, ns.
        stamps: of the recorded references, ns, increasing, shape (stamps,).
        values: of the recorded references, rad and s, shape (3, stamps, joints).
        lacking: stamps to be filled, ns, shape (lacking,).
    """
    motion = _motion(parameters)
    if motion is None or not set(joints) <= set(motion[1]):
        return None
    places = np.array([motion[1].index(joint) for joint in joints], dtype=np.intp)
    known = KnownMotion(motion[0], places, start)
    compared = _spread(stamps, lacking)
    return known if np.array_equal(known.at(stamps[compared]), values[:, compared]) else None


def _motion(parameters: object) -> tuple[ReferenceMotion, tuple[str, ...]] | None:
    """The motion, and the names of its joints in its order."""
    if not isinstance(parameters, dict):
        return None
    file = parameters.get("reference.file")
    if file is not None and not (isinstance(file, str) and Path(file).is_file()):
        return None
    try:
        values = resolve(NODE_SCHEMAS["trajectory"], parameters, reference_joints(parameters))
        return ReferenceMotion(values), names(values["joints"])
    except ParameterError:  # It was recorded with another version, or the file has changed.
        return None


def _spread(stamps: Stamps, lacking: Stamps) -> NDArray[np.intp]:
    """Indices of `stamps` next to those that lack, and of others, spread evenly; `_COMPARED` at most."""
    if stamps.size == 0:
        return np.empty(0, dtype=np.intp)
    after = np.searchsorted(stamps, lacking)
    neighbours = np.unique(np.clip(np.concatenate([after - 1, after]), 0, stamps.size - 1))
    both = [_evenly(neighbours, _COMPARED // 2), _evenly(np.arange(stamps.size), _COMPARED // 2)]
    return np.unique(np.concatenate(both))


def _evenly(indices: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """At most `count` of the indices, spread evenly, with the first and the last."""
    if indices.size <= count:
        return indices
    return indices[np.linspace(0, indices.size - 1, count).round().astype(np.intp)]


def near(stamps: Stamps, lacking: Stamps) -> Stamps:
    """Those of the stamps that lack a reference which are at most `LONGEST_GAP` from a recorded one.

    Args:
        stamps: of the recorded references, ns, increasing, shape (stamps,).
        lacking: stamps without a reference, ns, shape (lacking,).
    """
    if stamps.size < 2:
        return np.empty(0, dtype=np.int64)
    after = np.clip(np.searchsorted(stamps, lacking), 1, stamps.size - 1)
    distance = np.minimum(np.abs(lacking - stamps[after - 1]), np.abs(lacking - stamps[after]))
    return lacking[distance <= LONGEST_GAP]


def interpolated(stamps: Stamps, values: Array, lacking: Stamps) -> Array:
    """Interpolate with the cubics that fit the neighbours' position and velocity, shape (3, lacking, joints).

    Args:
        stamps: of the recorded references, ns, increasing, at least two, shape (stamps,).
        values: of the recorded references, rad and s, shape (3, stamps, joints).
        lacking: stamps without a reference, ns, shape (lacking,).
    """
    from scipy.interpolate import CubicHermiteSpline  # Rarely needed, and slow to import.

    motion = CubicHermiteSpline((stamps - stamps[0]) / 1e9, values[0], values[1])
    return np.stack([motion((lacking - stamps[0]) / 1e9, order) for order in range(3)])
