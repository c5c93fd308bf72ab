"""The highest speed on a path within limits of speed and acceleration.

Reachability analysis of Pham and Pham (TOPP-RA, IEEE Transactions on Robotics 34(3), 2018): on a grid along the path,
backward the largest squared speeds from which the end can be reached at rest, then forward the largest acceleration.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import subroutine

_HALVINGS = 100
_HIGHEST = 1e12
"""Squared speed that is high enough, 1/s^2."""
_STRAIGHT = 1e-12
"""A joint whose derivative is smaller does not move along the path."""


@subroutine
def _interval(z: float, slope: Array, bend: Array, limit: Array) -> tuple[float, float]:
    """Accelerations along the path that the joints allow at the squared speed z: from the first to the second number.

    `slope` and `bend` are the derivatives of the path, `limit` the accelerations of the joints, shape (joints,).
    """
    low, high = -math.inf, math.inf
    for j in range(slope.size):
        if abs(slope[j]) > _STRAIGHT:
            one = (limit[j] - bend[j] * z) / slope[j]
            other = (-limit[j] - bend[j] * z) / slope[j]
            low, high = max(low, min(one, other)), min(high, max(one, other))
        elif abs(bend[j]) * z > limit[j]:
            return 1.0, 0.0
    return low, high


@subroutine
def path_speed(grid: Array, slopes: Array, bends: Array, highest: Array, acceleration: Array, squared: Array) -> None:
    """Write the largest squared speeds on a grid, from rest to rest.

    Args:
        grid: path parameter, increasing, shape (n,).
        slopes: first derivative of the path by its parameter, shape (n, joints), rad.
        bends: second derivative, likewise.
        highest: limits of the squared speed, shape (n,), 1/s^2.
        acceleration: limits of the joints, shape (joints,), rad/s^2.
        squared: result, shape (n,), 1/s^2.
    """
    last = grid.size - 1
    squared[last] = 0.0
    for i in range(last - 1, -1, -1):
        step = grid[i + 1] - grid[i]
        # The speeds that are possible, and from which the next point is reached slowly enough, are an interval from 0.
        bottom, top = 0.0, min(highest[i], _HIGHEST)
        middle = top
        for _ in range(_HALVINGS):
            low, high = _interval(middle, slopes[i], bends[i], acceleration)
            if low <= high and middle + 2.0 * step * low <= squared[i + 1]:
                bottom = middle
            else:
                top = middle
            middle = 0.5 * (bottom + top)
        squared[i] = bottom
    squared[0] = 0.0
    for i in range(last):
        step = grid[i + 1] - grid[i]
        _, high = _interval(squared[i], slopes[i], bends[i], acceleration)
        squared[i + 1] = min(squared[i + 1], max(0.0, squared[i] + 2.0 * step * high))
