"""Whether the position or the torque of a joint is inverted, if gravity does not tell: its couplings to others do.

A joint of which both seem to count in the other direction is accelerated by its own torque as described, but others
that are accelerated throw it to the wrong side. So it is shaken together with the others, which shall stay where they
are: once if the one, once if the other is inverted. Its own way then tells the sign of the couplings.
"""

from collections.abc import Sequence

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.commissioning.catch import FARTHEST, Catch
from pidtsm_studies.commissioning.weigh import SHORTEST, first_push, hardest_push, shake, sliding

_CLEAR, _WIDE = 1.5, 0.3
"""Way of joints that tells something, as a multiple of what is visible; and share of `FARTHEST` from which on a joint
is not shaken more."""
_HARDER = 1.5
"""Factor of the torques if they tell nothing yet."""
_COUPLED = 0.05
"""Couplings, relative to the inertia of the joint, that can tell something."""
_SURELY, _EXPLAINS = 0.3, 0.7
"""Share of the described couplings that is found at least; and what they leave of the way, relative to what is left
without them."""


def is_mirrored(catch: Catch, j: int, turned: Array) -> bool | None:
    """Whether a joint reacts to the others as if both its position and its torque were inverted; None: unknown.

    Args:
        catch: what holds the arm, with signs of the torques that hold it.
        j: the joint.
        turned: -1 where that is so of other joints, else 1, shape (joints,).

    Raises:
        AwayError: a joint moves too far; commands have ceased.
    """
    other = turned.copy()
    other[j] *= -1.0
    couplings = [_couplings(catch, j, each) for each in (turned, other)]
    same, changed = 0.5 * (couplings[0] + couplings[1]), 0.5 * (couplings[0] - couplings[1])
    changed[np.abs(changed) < _COUPLED] = 0.0
    if not changed.any():
        return None
    patterns = [np.where(np.arange(same.size) == j, 1.0, each) for each in couplings]
    push, bound = first_push(catch, j), min(hardest_push(catch, each) for each in patterns)
    while True:
        push = min(push, bound)
        shaken = []
        for pattern in patterns:
            shaken.append(shake(catch, push * pattern))
            shake(catch, np.zeros_like(pattern))
        if min(len(positions) for positions, _ in shaken) < SHORTEST:
            return None
        ways = np.max([np.ptp(positions, axis=0) for positions, _ in shaken], axis=0)
        if np.all(ways[j] > _CLEAR * catch.visible[j]) and np.any((ways > _CLEAR * catch.visible) & (changed != 0.0)):
            share, left = _share(shaken, j, catch.port.period, same, changed)
            if abs(share) > _SURELY and left < _EXPLAINS:
                return share < 0.0
        if push == bound or ways.max() > _WIDE * FARTHEST:
            return None
        push *= _HARDER


def _couplings(catch: Catch, j: int, turned: Array) -> Array:
    """What the acceleration of each other joint takes from joint j's, shape (joints,); 0 of joint j."""
    inertia = turned[:, np.newaxis] * catch.model.inertia(turned * catch.start) * turned
    result = inertia[:, j] / max(inertia[j, j], catch.inertia[j, j])
    result[j] = 0.0
    return np.asarray(result)


def _share(
    shaken: Sequence[tuple[Array, Array]], j: int, dt: float, same: Array, changed: Array
) -> tuple[float, float]:
    """Share of the couplings `changed` that is found, negative if they are inverted, and what they leave of the way.

    From way of joint j + `same` times ways of the others = a + b t + c t^2 + mobility times (double integral of the
    torque, without friction) - share times `changed` times ways of the others.
    """
    blocks, values, columns = [], [], []
    for positions, torques in shaken:
        ways = positions - positions[0]
        time = dt * np.arange(len(ways))
        twice = (dt**2 * np.cumsum(np.cumsum(each)) for each in (torques[:, j], sliding(ways[:, j], dt)))
        blocks.append(np.column_stack([np.ones_like(time), time, time**2]))
        columns.append(np.column_stack([*twice, -ways @ changed]))
        values.append(ways[:, j] + ways @ same)
    free = np.zeros((sum(map(len, blocks)), 3 * len(blocks)))
    row = 0
    for k, block in enumerate(blocks):
        free[row : row + len(block), 3 * k : 3 * k + 3] = block
        row += len(block)
    whole, value = np.hstack([free, np.vstack(columns)]), np.concatenate(values)
    size = np.abs(whole).max(axis=0) + 1e-12
    fit = np.linalg.lstsq(whole / size, value, rcond=None)[0]
    without = np.linalg.lstsq((whole / size)[:, :-1], value, rcond=None)[0]
    left = np.std(value - whole / size @ fit) / max(float(np.std(value - (whole / size)[:, :-1] @ without)), 1e-12)
    return float(fit[-1] / size[-1]), float(left)
