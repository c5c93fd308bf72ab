"""A smooth curve through targets that arrive one by one: cubics that overshoot no step."""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit

FADE = 0.08
"""Time in which the curve comes to rest after its last target, s."""


@njit
def evaluate(times: Array, knots: Array, t: float, target: Array) -> None:
    """Write q, q', q'' of the curve at t (s) to `target`, shape (3, joints).

    Before the first knot it rests there; after the last one it comes to rest within `FADE`, at even deceleration.

    Args:
        times: of the knots, s, increasing, shape (n,).
        knots: positions and velocities there, shape (n, 2, joints), rad, rad/s.
        t: time, s.
        target: result.
    """
    last = times.size - 1
    if t >= times[last]:
        past = min(t - times[last], FADE)
        for j in range(target.shape[1]):
            v = knots[last, 1, j]
            target[0, j] = knots[last, 0, j] + v * past * (1.0 - 0.5 * past / FADE)
            target[1, j] = v * (1.0 - past / FADE)
            target[2, j] = -v / FADE if past < FADE else 0.0
        return
    k = last - 1
    while k > 0 and times[k] > t:
        k -= 1
    if k < 0 or t < times[k]:
        for j in range(target.shape[1]):
            target[0, j], target[1, j], target[2, j] = knots[0, 0, j], 0.0, 0.0
        return
    h = times[k + 1] - times[k]
    z = (t - times[k]) / h
    for j in range(target.shape[1]):
        a, b = knots[k, 1, j] * h, knots[k + 1, 1, j] * h
        way = knots[k + 1, 0, j] - knots[k, 0, j]
        c, d = 3.0 * way - 2.0 * a - b, a + b - 2.0 * way
        target[0, j] = knots[k, 0, j] + z * (a + z * (c + z * d))
        target[1, j] = (a + z * (2.0 * c + 3.0 * z * d)) / h
        target[2, j] = (2.0 * c + 6.0 * z * d) / (h * h)


def velocities(times: Array, positions: Array, acceleration: Array) -> Array:
    """Velocities of a curve through targets, shape (n, joints), rad/s: those of the parabolas through three targets.

    Where such a parabola needs more than the acceleration, the target steps, and the cubics must not overshoot it: the
    velocity is at most twice the smaller mean velocity on both sides, and zero where the targets turn back or pause
    (van Leer's limiter, J. Comput. Phys. 23, 1977). A step is therefore not extrapolated. The first velocity is zero.

    Args:
        times: s, increasing, shape (n,).
        positions: shape (n, joints), rad.
        acceleration: shape (joints,), rad/s^2.
    """
    result = np.zeros_like(positions)
    if len(times) < 3:
        return result
    h = np.diff(times)[:, None]
    mean = np.diff(positions, axis=0) / h
    half = (mean[1:] - mean[:-1]) / (h[1:] + h[:-1])
    before, after = mean[:-1], mean[1:]
    rates = np.concatenate([before + half * h[:-1], after[-1:] + half[-1:] * h[-1]])
    nearest = np.concatenate([np.arange(len(half)), [len(half) - 1]])
    most = 2.0 * np.minimum(np.abs(before), np.abs(after))[nearest]
    same = (before * after > 0.0)[nearest] & (rates * after[nearest] > 0.0)
    limited = np.where(same, np.sign(rates) * np.minimum(np.abs(rates), most), 0.0)
    result[1:] = np.where(2.0 * np.abs(half[nearest]) <= acceleration, rates, limited)
    return result
