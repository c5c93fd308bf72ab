"""What is wrong with a measurement, before anything is fitted to it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import nnls

from pidtsm_core.identification.measurement import Measurement, Motion
from pidtsm_core.identification.regressor import LINK, regressor
from pidtsm_core.parameters import Array

_LEAST_MOTION = 0.05
"""rad or m; a joint that moves less counts as standing still."""
_LARGEST_LOSS = 0.01
"""Share of missing samples that needs no mention."""
_AT_LIMIT = 0.995
"""Share of the limit that counts as the limit."""
_OFTEN_AT_LIMIT = 0.002
"""Share of the samples at the limit that needs mention, and that counts as a limit where none is described."""
_STATES = 250
"""States in which the description is compared with the data."""
_LEAST_GRAVITY, _MOST_GRAVITY = 0.5, 1.5
"""How many times the torques contain gravity: 0.8 to 1.4 if masses and centres of the description are up to 30 % wrong;
1.6 to 2.8 if the torques do contain it twice (measured with 40 such descriptions of each of three arms)."""
_LITTLE = 0.1
"""Share of gravity, or of the other torques of the links, below which it cannot be judged."""
_WITHOUT = "the torques lack gravity, which the robot adds itself"
_TWICE = "the torques contain gravity twice"
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
    low, high = np.percentile(measurement.position, (1.0, 99.0), axis=0)
    moving = high - low >= _LEAST_MOTION
    still = _listed(measurement.joints, ~moving)
    if not moving.any():
        yield Fault("the arm stands still; record a motion of all joints, see ./pidtsm excite", fatal=True)
    elif moving.size > 1 and np.count_nonzero(moving) == 1:
        only = _listed(measurement.joints, moving)
        yield Fault(f"only {only} moves; record a motion of all joints, see ./pidtsm excite", fatal=True)
    elif not moving.all():
        yield Fault(f"too little motion of {still}: what they show stays as the description has it", fatal=False)
    share = np.mean(np.abs(measurement.effort) >= measurement.limit, axis=0)
    for joint, part in zip(measurement.joints, share, strict=True):
        if part > _OFTEN_AT_LIMIT:
            text = f"the torque of {joint} is at its limit in {100.0 * part:.1f} % of the samples, which are not used"
            yield Fault(text, fatal=False)


def structure_faults(tree: Array, parameters: Array, joints: Sequence[str], motion: Motion) -> Iterator[Fault]:
    """Joints in a wrong order, wrong signs, and gravity missing or counted twice.

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
    found, unexplained = [], _unexplained(tree, links, data, size)
    for _ in joints:
        changes = list(_changes(tree, links, joints, data))
        scores = [_unexplained(tree, links, changed, size) for _, changed in changes]
        best = int(np.argmin(scores))
        # Gravity is judged apart, since masses that are too small look the same here.
        if scores[best] > _CLEARLY_BETTER * unexplained or changes[best][0] in (_WITHOUT, _TWICE):
            break
        text, data = changes[best]
        unexplained = scores[best]
        found.append(text)
    factor = _gravity_factor(tree, links, data, size)
    found += [_WITHOUT] if factor < _LEAST_GRAVITY else [_TWICE] if factor > _MOST_GRAVITY else []
    yield from (Fault(text, fatal=True) for text in found)


def _changes(tree: Array, links: Array, joints: Sequence[str], data: Array) -> Iterator[tuple[str, Array]]:
    """Data as they would be without one mistake, and the mistake."""
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
    for text, factor in ((_WITHOUT, 1.0), (_TWICE, -1.0)):
        changed = data.copy()
        changed[3] += factor * gravity
        yield text, changed


def _gravity_factor(tree: Array, links: Array, data: Array, size: Array) -> float:
    """How many times the torques contain gravity, with free friction, armature and offset.

    Wrong masses change gravity about as much as the other torques of the links, so it is relative to those where the
    motion is fast enough. 1 if gravity does not change with the posture.
    """
    q, dq, ddq, effort = data
    gravity = _rigid(tree, links, q, 0.0 * dq, 0.0 * ddq)
    rest = _rigid(tree, links, q, dq, ddq) - gravity
    rows = []
    for j, variance in enumerate(size):
        free = np.stack([ddq[:, j], dq[:, j], np.sign(dq[:, j]), np.ones(len(q))], axis=1)
        columns = np.stack([gravity[:, j], rest[:, j], effort[:, j]], axis=1)
        rows.append((columns - free @ np.linalg.lstsq(free, columns, rcond=None)[0]) / np.sqrt(variance))
    stacked = np.concatenate(rows)
    of_gravity, of_rest, of_effort = np.linalg.norm(stacked, axis=0)
    if of_gravity < _LITTLE * of_effort:
        return 1.0
    factor, of_links = np.linalg.lstsq(stacked[:, :2], stacked[:, 2], rcond=None)[0]
    return float(factor / of_links if of_rest > _LITTLE * of_effort and of_links > 0.0 else factor)


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


def _listed(joints: Sequence[str], chosen: Array) -> str:
    return ", ".join(joint for joint, is_chosen in zip(joints, chosen, strict=True) if is_chosen)
