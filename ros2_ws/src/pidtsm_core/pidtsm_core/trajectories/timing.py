"""Fast motions through way points that have no times."""

import math
from bisect import bisect_left
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from pidtsm_core.arrays import Array
from pidtsm_core.trajectories.checking import check, excessive_effort
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.interpolation import interpolate
from pidtsm_core.trajectories.jerk_limited import fastest_line
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.margins import PLANNED_SHARE
from pidtsm_core.trajectories.motion import PiecewiseMotion
from pidtsm_core.trajectories.path_speed import path_speed

_FASTEST = 1e3
"""Largest velocity of a joint without a limit, rad/s or m/s."""
_GRID = 400
"""Least number of steps along a path."""
_WIDTHS = 8
"""Number of times over which a motion is averaged, about that in which the jerk reaches the largest acceleration."""
_SHORTEST = 1.0 / 300.0
"""Shortest of these times, relative to the duration."""
_FINE, _COARSE = 64, 16
"""Samples in one of these times, and how many of them make one segment of the motion."""
_NEWTON = 4
"""Rounds of Newton's method for the times at which way points are passed."""
_BELOW = 1.0 - 1e-5
"""Share of the velocity limits that is used: with times of whole nanoseconds, as in messages, they are kept, too."""
_SAME = 1e-9
"""Way points closer to each other count once, rad or m."""
_STEP = 1.05
"""Factor by which a motion is slowed down until the efforts suffice."""
_SLOWEST = 60
"""How often at most; what is 1.05^60 = 19 times slower needs no more effort than gravity does."""


class Along(NamedTuple):
    """What else moves along with the joints, within limits of its own.

    Attributes:
        places: where it is at the way points, shape (n, m).
        velocity, acceleration, jerk: its limits, shape (m,), 1/s, 1/s^2 and 1/s^3 of the unit of the places.
    """

    places: Array
    velocity: Array
    acceleration: Array
    jerk: Array


def retime(waypoints: Array, limits: MotionLimits, along: Along | None = None) -> PiecewiseMotion:
    """A fast motion from rest at the first way point to rest at the last one, within all limits.

    With two way points it is the fastest motion on the straight line between them. With more it passes through all of
    them on a spline and without stopping. If it needs more than `MotionLimits.planned_effort`, it is slowed down as a
    whole.

    Args:
        waypoints: shape (n, joints), rad or m.
        limits: of the arm.
        along: what keeps limits of its own; None: nothing.

    Returns:
        A motion that begins at time 0; behind the joints come those of `along`.

    Raises:
        TrajectoryError: a number is not finite, or the motion leaves the position limits, or gravity alone needs more
            effort than is allowed.
    """
    joints, within = waypoints.shape[1], replace(limits, velocity=_BELOW * limits.velocity)
    moving = within
    if along is not None:
        waypoints = np.hstack([waypoints, along.places])
        moving = replace(
            within,
            velocity=np.append(within.velocity, along.velocity / PLANNED_SHARE),
            acceleration=np.append(within.acceleration, along.acceleration),
            jerk=np.append(within.jerk, along.jerk),
        )
    if not np.isfinite(waypoints).all():
        raise TrajectoryError("a way point contains a number that is not finite")
    moves = np.abs(np.diff(waypoints, axis=0)).max(axis=1) > _SAME
    waypoints = waypoints[np.concatenate([[True], moves])]
    motion = _on_a_line(waypoints, moving) if len(waypoints) <= 2 else _on_a_spline(waypoints, moving)
    slow = _slowed_down(PiecewiseMotion(motion.parameters[:joints]), within)
    check(slow, limits)
    return slow if along is None else motion.stretched(slow.end / motion.end)


def _slowed_down(motion: PiecewiseMotion, limits: MotionLimits) -> PiecewiseMotion:
    """The motion, slowed down until the efforts suffice, or as far as is tried."""
    slowest = motion.stretched(_STEP**_SLOWEST)
    # Where gravity alone needs more, no slower motion would help.
    spares = excessive_effort(slowest, _spare(slowest, limits)) is None

    def suffices(steps: int) -> bool:
        slower = motion.stretched(_STEP**steps)
        return excessive_effort(slower, _spare(slower, limits) if spares else limits) is None

    if suffices(0):
        return motion
    # The slower, the nearer the efforts are to those of gravity: a motion that suffices still does when it is slower.
    steps = bisect_left(range(_SLOWEST), True, lo=1, key=suffices)
    return motion.stretched(_STEP**steps)


def _spare(motion: PiecewiseMotion, limits: MotionLimits) -> MotionLimits:
    """Limits of the effort that leave the rest for friction and for the law."""
    powers = motion.coefficients[..., 1:] * np.arange(1, motion.coefficients.shape[-1])
    fastest = np.abs(powers @ _bernstein(powers.shape[-1]).T).max(axis=-1) / np.diff(motion.times)
    return replace(limits, effort=limits.planned_effort(fastest.max(axis=-1)))


def _on_a_line(waypoints: Array, limits: MotionLimits) -> PiecewiseMotion:
    """The fastest motion between two way points; of one, to stay there."""
    velocity = np.minimum(limits.planned_velocity, _FASTEST)
    return fastest_line(waypoints[0], waypoints[-1], velocity, limits.acceleration, limits.jerk)


def _on_a_spline(waypoints: Array, limits: MotionLimits) -> PiecewiseMotion:
    """A motion through at least three way points, of which neighbours differ.

    The fastest motion along a spline within limits of velocity and acceleration is averaged over a time, which limits
    its jerk: the shorter the time, the higher the jerk. Of several times that one is best with which the motion is
    fastest after it has been slowed down until it keeps all limits.
    """
    # The path, by the share of its length, between way points.
    lengths = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    knots = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()
    path = CubicSpline(knots, waypoints, bc_type="natural")
    parts = np.arange(-(-_GRID // len(lengths))) / -(-_GRID // len(lengths))
    grid = np.append(knots[:-1, None] + np.diff(knots)[:, None] * parts, 1.0)
    # Its fastest motion.
    squared = np.empty(grid.size)
    slopes, jerks = (np.abs(path(grid, order)) for order in (1, 3))
    jerks[1:] = np.maximum(jerks[1:], jerks[:-1])  # It jumps at way points.
    with np.errstate(divide="ignore"):
        by_velocity = (np.minimum(limits.planned_velocity, _FASTEST) / slopes) ** 2
        by_jerk = (limits.jerk / jerks) ** (2.0 / 3.0)
    highest = np.minimum(by_velocity, by_jerk).min(axis=1)
    path_speed(grid, path(grid, 1), path(grid, 2), highest, limits.acceleration, squared)
    speed = np.sqrt(squared)
    times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(grid) / (speed[1:] + speed[:-1]))])
    ramp = float((limits.acceleration / limits.jerk).max())
    motions = []
    shortest = max(0.5 * min(ramp, times[-1]), _SHORTEST * times[-1])
    for width in np.geomspace(shortest, max(3.0 * ramp, 2.0 * shortest), _WIDTHS):
        passed, place = _averaged(times, grid, speed, float(width), knots)
        points = path(place)
        start = np.zeros((3, waypoints.shape[1]))
        start[0], points[-1] = waypoints[0], waypoints[-1]
        motion = interpolate(passed, points[1:, None], start)
        motions.append(motion.stretched(float(_excess(motion, limits).max())))
    return min(motions, key=lambda motion: motion.end)


def _averaged(times: Array, grid: Array, speed: Array, width: float, knots: Array) -> tuple[Array, Array]:
    """Where on the path a motion is, averaged over a time.

    Args:
        times: at which the grid is passed, s, shape (n,).
        grid: path parameter, shape (n,).
        speed: at these times, 1/s, shape (n,); it changes linearly between them.
        width: the time, s.
        knots: path parameters of the way points.

    Returns:
        Some times (s), among them those of the way points, and the path parameters then.
    """
    step = width / _FINE
    t = step * np.arange(math.ceil(times[-1] / step) + 1)
    i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, times.size - 2)
    duration, since = (times[1:] - times[:-1])[i], np.minimum(t, times[-1]) - times[i]
    place = grid[i] + since * (speed[i] + 0.5 * since / duration * (speed[i + 1] - speed[i]))
    padded = np.concatenate([np.zeros(_FINE), place, np.ones(_FINE)])
    total = np.concatenate([[0.0], np.cumsum(0.5 * (padded[1:] + padded[:-1]))])
    averaged = (total[_FINE:] - total[:-_FINE]) / _FINE
    t = step * np.arange(averaged.size)
    law = CubicSpline(t, averaged)
    at_knots = np.interp(knots, averaged, t)
    for _ in range(_NEWTON):
        at_knots[1:-1] -= (law(at_knots[1:-1]) - knots[1:-1]) / law(at_knots[1:-1], 1)
    at_knots[0], at_knots[-1] = 0.0, t[-1]
    even = np.linspace(0.0, t[-1], math.ceil(t[-1] / step / _COARSE) + 1)
    distance = np.abs(even[:, None] - at_knots).min(axis=1)
    chosen = np.unique(np.concatenate([at_knots, even[distance > 0.3 * _COARSE * step]]))
    return chosen, law(chosen)


def _excess(motion: PiecewiseMotion, limits: MotionLimits) -> Array:
    """Factor by which each segment must last longer to keep the limits, shape (segments,).

    Derivatives are bounded by their Bernstein coefficients, so the factor is a little larger than necessary.
    """
    powers, durations = motion.coefficients, np.diff(motion.times)
    result = np.zeros(len(durations))
    for order, limit in enumerate((limits.planned_velocity, limits.acceleration, limits.jerk), start=1):
        powers = powers[..., 1:] * np.arange(1, powers.shape[-1])
        bound = np.abs(powers @ _bernstein(powers.shape[-1]).T).max(axis=-1) / durations**order
        result = np.maximum(result, (bound / limit[:, None]).max(axis=0) ** (1.0 / order))
    return result


def _bernstein(count: int) -> Array:
    """The matrix that turns coefficients of the powers 0 to count - 1 into Bernstein coefficients."""
    degree = count - 1
    return np.array([[math.comb(i, j) / math.comb(degree, j) for j in range(count)] for i in range(count)])
