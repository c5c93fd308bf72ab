"""What is wrong with a measurement, before anything is fitted to it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from pidtsm_core.arrays import Array
from pidtsm_core.identification.base_parameters import base_parameters
from pidtsm_core.identification.consistency import Prior, expectation
from pidtsm_core.identification.least_squares import motion_regressor
from pidtsm_core.identification.measurement import Measurement, Motion
from pidtsm_core.identification.motion_needs import moves_enough
from pidtsm_core.identification.regressor import regressor
from pidtsm_core.robots.tree.layout import GRAVITY
from pidtsm_core.robots.tree.unit_forces import LINK

_LARGEST_LOSS = 0.01
"""Share of missing samples that needs no mention."""
_AT_LIMIT = 0.995
"""Share of the limit that counts as the limit."""
_OFTEN_AT_LIMIT = 0.002
"""Share of the samples at the limit that needs mention, and that counts as a limit where none is described."""
_STATES = 250
"""States in which the description is compared with the data."""
_GRAVITIES = (
    (0.0, "the torques lack gravity, which the robot adds itself; record those of its motors"),
    (2.0, "the torques contain gravity twice; record those of the motors, to which nothing has been added"),
)
_COARSE = 0.2
"""Standard deviation of what a coarse model leaves unexplained, as a share of the torque's."""
_NEARER = 0.9
"""Share of the distance from data and description that remains with the right gravity: at most 0.78 if the torques lack
gravity or contain it twice, 1.18 and more if they do not (80 descriptions of two-link arm, UR5 and Panda, 30 % off)."""
_CLEARLY_BETTER = 0.5
"""A changed measurement that leaves less than this share of the torque unexplained is what was meant."""


@dataclass(frozen=True)
class Fault:
    """Something wrong with a measurement.

    Attributes:
        text: a sentence.
        fatal: whether nothing can be identified.
    """

    text: str
    fatal: bool


def limited(measurement: Measurement, limit: Array) -> Measurement:
    """The measurement with the limits of its efforts: those described, and those at which they stay.

    Args:
        measurement: the measurement.
        limit: of the description, shape (joints,), N m or N; infinite if there is none.
    """
    size = np.abs(measurement.effort)
    largest = size.max(axis=0)
    stays = np.mean(size >= 0.9999 * largest, axis=0) > _OFTEN_AT_LIMIT
    found = np.where(stays & (largest > 0.0), largest, np.inf)
    return replace(measurement, limit=_AT_LIMIT * np.minimum(limit, found))


def recording_faults(measurement: Measurement) -> Iterator[Fault]:
    """What positions and efforts alone show: missing samples, joints that stand still, torques at their limit."""
    if measurement.missing > _LARGEST_LOSS:
        text = f"{100.0 * measurement.missing:.1f} % of the samples are missing"
        yield Fault(f"{text}; short gaps are interpolated, the recording is cut at long ones", fatal=False)
    moving = moves_enough(measurement.position)
    if not moving.any():
        yield Fault("the arm stands still; record a motion of all joints", fatal=True)
    elif moving.size > 1 and np.count_nonzero(moving) == 1:
        only = _listed(measurement.joints, moving)
        still = _listed(measurement.joints, ~moving)
        yield Fault(f"only {only} moves, not {still}; record a motion of all joints", fatal=True)
    share = np.mean(np.abs(measurement.effort) >= measurement.limit, axis=0)
    for joint, part in zip(measurement.joints, share, strict=True):
        if part > _OFTEN_AT_LIMIT:
            text = f"the torque of {joint} is at its limit in {100.0 * part:.1f} % of the samples, which are not used"
            yield Fault(text, fatal=False)


def structure_faults(tree: Array, parameters: Array, joints: Sequence[str], motion: Motion) -> Iterator[Fault]:
    """Joints in a wrong order, and wrong signs.

    The description need not be exact: a change of the data is reported if it leaves less than half as much of the
    torque unexplained, with free friction, armature and offsets.

    Args:
        tree: of the description, see `tree.layout`, shape (size(joints),).
        parameters: pi of the description, see `regressor`.
        joints: names.
        motion: filtered data, shape (samples, joints).
    """
    rows = np.linspace(0, len(motion.position) - 1, min(_STATES, len(motion.position))).astype(int)
    data = np.stack([motion.position, motion.velocity, motion.acceleration, motion.effort])[:, rows]
    links = parameters[: LINK * len(joints)]
    size = np.var(data[3], axis=0) + 1e-12
    unexplained = _unexplained(tree, links, data, size)
    for _ in joints:
        changes = list(_changes(tree, links, joints, data))
        scores = [_unexplained(tree, links, changed, size) for _, changed in changes]
        best = int(np.argmin(scores))
        text = changes[best][0]
        if scores[best] > _CLEARLY_BETTER * unexplained or not text:
            break
        data, unexplained = changes[best][1], scores[best]
        yield Fault(text, fatal=True)


def gravity_faults(tree: Array, prior: Prior, motion: Motion) -> Iterator[Fault]:
    """Gravity that is missing or counted twice.

    Masses that are too small look almost the same. So gravity is judged by the parameters that are the nearest to both
    data and description.

    Args:
        tree: of the description, see `tree.layout`, shape (size(joints),).
        prior: what the description says.
        motion: filtered data, shape (samples, joints).
    """
    few = motion.at(np.linspace(0, len(motion.position) - 1, min(_STATES, len(motion.position))).astype(int))
    distances = []
    for factor, text in _GRAVITIES:
        changed = tree.copy()
        changed[:GRAVITY] *= factor
        distances.append((_distance(changed, prior, few), text))
    distance, text = min(distances)
    if distance < _NEARER * _distance(tree, prior, few):
        yield Fault(text, fatal=True)


def _distance(tree: Array, prior: Prior, motion: Motion) -> float:
    """Distance of the nearest base parameters from data and description, in standard deviations."""
    base = base_parameters(tree, len(prior.carriers))
    expected = expectation(prior, base)
    scale = _COARSE * (np.std(motion.effort, axis=0) + 1e-12)
    columns = motion_regressor(tree, motion)[..., base.columns] / scale[:, np.newaxis]
    system = np.vstack([columns.reshape(-1, base.columns.size), np.diag(1.0 / expected.deviation)])
    values = np.concatenate([(motion.effort / scale).ravel(), expected.beta / expected.deviation])
    return float(np.linalg.norm(system @ np.linalg.lstsq(system, values, rcond=None)[0] - values))


def _changes(tree: Array, links: Array, joints: Sequence[str], data: Array) -> Iterator[tuple[str, Array]]:
    """The mistake, and data as they would be without it.

    No text stands for gravity that is missing or counted twice, see `gravity_faults`.
    """
    for i, k in combinations(range(len(joints)), 2):
        order = np.arange(len(joints))
        order[[i, k]] = k, i
        yield f"the data of {joints[i]} and {joints[k]} are swapped", data[..., order]
    for shift in range(1, len(joints) if len(joints) > 2 else 1):
        shifted = ", ".join(np.roll(joints, shift))
        yield f"the joints have the order {shifted}", np.roll(data, -shift, axis=2)
    yield f"the joints have the order {', '.join(reversed(joints))}", data[..., ::-1]
    yield "the signs of all torques are wrong", data * np.array([1.0, 1.0, 1.0, -1.0])[:, np.newaxis, np.newaxis]
    for j, joint in enumerate(joints):
        for what, signs in (
            ("torque", (1.0, 1.0, 1.0, -1.0)),
            ("position", (-1.0, -1.0, -1.0, 1.0)),
            ("position and torque", (-1.0, -1.0, -1.0, -1.0)),
        ):
            changed = data.copy()
            changed[..., j] *= np.array(signs)[:, np.newaxis]
            yield f"the sign of the {what} of {joint} is wrong", changed
    gravity = _rigid(tree, links, data[0], 0.0 * data[1], 0.0 * data[2])
    for factor in (1.0, -1.0):
        changed = data.copy()
        changed[3] += factor * gravity
        yield "", changed


def _rigid(tree: Array, links: Array, q: Array, dq: Array, ddq: Array) -> Array:
    """Efforts of the links, shape (samples, joints), N m or N."""
    return np.asarray(regressor(tree, q, dq, ddq)[..., : links.size] @ links)


def _unexplained(tree: Array, links: Array, data: Array, size: Array) -> float:
    """Mean share of the torque's variance `size` that description, friction, armature and offset do not explain."""
    q, dq, ddq, effort = data
    rest = effort - _rigid(tree, links, q, dq, ddq)
    shares = []
    for j, variance in enumerate(size):
        # Friction and armature cannot be negative, an offset can.
        columns = np.stack([ddq[:, j], dq[:, j], np.sign(dq[:, j])], axis=1)
        columns -= columns.mean(axis=0)
        shares.append(nnls(columns, rest[:, j] - rest[:, j].mean())[1] ** 2 / (len(rest) * variance))
    return float(np.mean(np.minimum(shares, 4.0)))


def _listed(joints: Sequence[str], chosen: NDArray[np.bool_]) -> str:
    return ", ".join(joint for joint, is_chosen in zip(joints, chosen, strict=True) if is_chosen)
