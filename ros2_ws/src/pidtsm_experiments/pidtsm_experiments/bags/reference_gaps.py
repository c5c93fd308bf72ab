"""References missing in a bag: computed like the trajectory node does, or interpolated if its motion is unknown."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.experiment.node_parameters import NODE_SCHEMAS
from pidtsm_core.parameters import ParameterError, names, resolve
from pidtsm_core.recording import Stamps
from pidtsm_core.references import ReferenceMotion, reference_joints
from pidtsm_core.timing import seconds

LONGEST_GAP = 100_000_000
"""Largest distance of an interpolated reference from a recorded one, ns."""

_COMPARED = 200  # recorded references that are compared with a known motion


@dataclass(frozen=True)
class KnownMotion:
    """The motion published by the trajectory node.

    Attributes:
        motion: the motion.
        places: indices of the recording's joints in the motion, shape (joints,).
        start: stamp of its start, ns.
    """

    motion: ReferenceMotion
    places: NDArray[np.intp]
    start: int

    def at(self, stamps: Stamps) -> Array:
        """q_d, q_d', q_d'', bit for bit as in the trajectory node, rad or m, and s, shape (3, stamps, joints)."""
        desired = np.zeros((3, self.motion.joints))
        values = np.empty((3, stamps.size, self.places.size))
        for k, elapsed in enumerate((stamps - self.start).tolist()):
            self.motion.evaluate(seconds(elapsed), desired)
            values[:, k] = desired[:, self.places]
        return values

    def stays_out(self, stamps: Stamps) -> NDArray[np.bool_]:
        """Whether each of these stamps is in the simulated loss of references, shape (stamps,)."""
        elapsed = (stamps - self.start) / 1e9
        return (self.motion.config.dropout_begin <= elapsed) & (elapsed < self.motion.config.dropout_end)


def known_motion(
    parameters: object, joints: Sequence[str], start: int, stamps: Stamps, values: Array, lacking: Stamps
) -> KnownMotion | None:
    """The motion described by the parameters in a bag, None if it differs from the recorded one.

    The recorded motion differs if a trajectory was commanded, or if the reference file has changed.

    Args:
        parameters: parameters of the trajectory node by name, from the bag; anything else gives None.
        joints: names, in the order of the recording.
        start: stamp of the first reference, with or without values, ns.
        stamps: stamps of the recorded references, ns, increasing, shape (stamps,).
        values: recorded references, rad or m, and s, shape (3, stamps, joints).
        lacking: stamps without a reference, ns, shape (lacking,).
    """
    motion = _motion(parameters)
    if motion is None or not set(joints) <= set(motion[1]):
        return None
    places = np.array([motion[1].index(joint) for joint in joints], dtype=np.intp)
    known = KnownMotion(motion[0], places, start)
    compared = _spread(stamps, lacking)
    return known if np.array_equal(known.at(stamps[compared]), values[:, compared]) else None


def _motion(parameters: object) -> tuple[ReferenceMotion, tuple[str, ...]] | None:
    """The motion and its joint names, in its order."""
    if not isinstance(parameters, dict):
        return None
    file = parameters.get("reference.file")
    if file is not None and not (isinstance(file, str) and Path(file).is_file()):
        return None
    try:
        values = resolve(NODE_SCHEMAS["trajectory"], parameters, reference_joints(parameters))
        return ReferenceMotion(values), names(values["joints"])
    except ParameterError:  # recorded with another version, or the file has changed
        return None


def _spread(stamps: Stamps, lacking: Stamps) -> NDArray[np.intp]:
    """Indices of `stamps` next to the lacking ones, and of others evenly spread; at most `_COMPARED`."""
    if stamps.size == 0:
        return np.empty(0, dtype=np.intp)
    after = np.searchsorted(stamps, lacking)
    neighbours = np.unique(np.clip(np.concatenate([after - 1, after]), 0, stamps.size - 1))
    both = [_evenly(neighbours, _COMPARED // 2), _evenly(np.arange(stamps.size), _COMPARED // 2)]
    return np.unique(np.concatenate(both))


def _evenly(indices: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """At most `count` of the indices, evenly spread, including the first and the last."""
    if indices.size <= count:
        return indices
    return indices[np.linspace(0, indices.size - 1, count).round().astype(np.intp)]


def near(stamps: Stamps, lacking: Stamps) -> Stamps:
    """Those of the `lacking` stamps that are at most `LONGEST_GAP` from a recorded reference.

    Args:
        stamps: stamps of the recorded references, ns, increasing, shape (stamps,).
        lacking: stamps without a reference, ns, shape (lacking,).
    """
    if stamps.size < 2:
        return np.empty(0, dtype=np.int64)
    after = np.clip(np.searchsorted(stamps, lacking), 1, stamps.size - 1)
    distance = np.minimum(np.abs(lacking - stamps[after - 1]), np.abs(lacking - stamps[after]))
    return lacking[distance <= LONGEST_GAP]


def interpolated(stamps: Stamps, values: Array, lacking: Stamps) -> Array:
    """Interpolate with cubics through the neighbours' positions and velocities, shape (3, lacking, joints).

    Args:
        stamps: stamps of the recorded references, ns, increasing, at least two, shape (stamps,).
        values: recorded references, rad or m, and s, shape (3, stamps, joints).
        lacking: stamps without a reference, ns, shape (lacking,).
    """
    from scipy.interpolate import CubicHermiteSpline  # rarely needed and slow to import

    motion = CubicHermiteSpline((stamps - stamps[0]) / 1e9, values[0], values[1])
    return np.stack([motion((lacking - stamps[0]) / 1e9, order) for order in range(3)])
