"""Piecewise polynomial motions, the common form of planned, recorded and commanded motions.

A motion of n segments is an array of shape (joints, 7 n + 1). Each row begins with the n + 1 times at which segments
begin and end; the coefficients follow, six per segment, as `pidtsm_core.references.polynomials.quintic` returns them.
"""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.references.polynomials import add_quintic, quintic


def piecewise(times: Array, starts: Array, ends: Array) -> Array:
    """Compute a motion from its states at both ends of every segment.

    Args:
        times: s, increasing, shape (n + 1,).
        starts: q, q', q'' at the start of each segment, shape (n, 3, joints), rad, rad/s, rad/s^2.
        ends: the same at its end.

    Returns:
        The motion, shape (joints, 7 n + 1), for `evaluate`.
    """
    n, _, joints = starts.shape
    motion = np.empty((joints, 7 * n + 1))
    motion[:, : n + 1] = times
    _fill(np.diff(times), starts, ends, motion)
    return motion


def through(times: Array, samples: Array) -> Array:
    """Compute a motion through samples.

    Args:
        times: s, increasing, at least two, shape (n,).
        samples: q, or q and q', or q, q', q'', shape (n, 1 to 3, joints), rad, rad/s, rad/s^2; missing derivatives are
            those of a cubic spline, and the quintic between two samples of such a spline equals it.

    Returns:
        The motion, shape (joints, 7 (n - 1) + 1), for `evaluate`.
    """
    from scipy.interpolate import CubicSpline  # This import takes longer than that of the rest of the core.

    known = samples.shape[1]
    if known < 3:
        spline = CubicSpline(times, samples[:, -1])
        missing = [spline(times, order) for order in range(1, 4 - known)]
        samples = np.concatenate([samples, np.stack(missing, axis=1)], axis=1)
    return piecewise(times, samples[:-1], samples[1:])


@njit
def _fill(durations: Array, starts: Array, ends: Array, motion: Array) -> None:
    """Write the coefficients of all segments; compiled, because a trajectory may have thousands."""
    n = durations.size
    for i in range(n):
        first = n + 1 + 6 * i
        quintic(starts[i], ends[i], durations[i], motion[:, first : first + 6].T)


@njit
def evaluate(t: float, p: Array, desired: Array) -> None:
    """Write q, q', q'' at t (s) to desired, shape (3, joints); at rest before the first segment and after the last."""
    n = (p.shape[1] - 1) // 7
    low, high = 0, n
    while high - low > 1:
        middle = (low + high) // 2
        if p[0, middle] <= t:
            low = middle
        else:
            high = middle
    start, end = p[0, low], p[0, low + 1]
    first = n + 1 + 6 * low
    for i in range(3):
        for j in range(desired.shape[1]):
            desired[i, j] = 0.0
    add_quintic(p[:, first : first + 6].T, end - start, min(max(t, start), end) - start, desired)
    if t < start or t >= end:
        for j in range(desired.shape[1]):
            desired[1, j] = 0.0
            desired[2, j] = 0.0
