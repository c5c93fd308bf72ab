"""Motions through points."""

from typing import Literal

import numpy as np
from scipy.linalg import solve_banded

from pidtsm_core.arrays import Array
from pidtsm_core.references.piecewise import piecewise
from pidtsm_core.trajectories.errors import StartError, TrajectoryError
from pidtsm_core.trajectories.motion import PiecewiseMotion

Interpolation = Literal["spline", "linear"]
"""What joins points that are positions only: a curve with continuous acceleration, or straight lines."""

_AT_REST = 1e-6  # rad/s


def plan(
    times: Array,
    points: Array,
    elapsed: float,
    present: Array,
    tolerance: float,
    interpolation: Interpolation = "spline",
) -> PiecewiseMotion:
    """Plan the rest of a trajectory, see `interpolate`, from the present state.

    Args:
        times: of the points, s from the start of the trajectory, shape (n,).
        points: positions, and velocities and accelerations where given, shape (n, 1 to 3, joints), rad, rad/s, rad/s^2.
        elapsed: s since the start; points up to this time are skipped.
        present: q, q', q'' at that time, shape (3, joints).
        tolerance: largest distance of the last skipped point from the present position, rad.
        interpolation: what joins points that are positions only.

    Returns:
        A motion that begins at `elapsed`.

    Raises:
        TrajectoryError: a number is not finite, the times do not increase, or the motion is over or does not end at
            rest.
        StartError: it starts too far away.
    """
    if not (np.isfinite(times).all() and np.isfinite(points).all()):
        raise TrajectoryError("it contains a number that is not finite")
    if times[0] < 0.0 or np.any(np.diff(times) <= 0.0):
        raise TrajectoryError("time_from_start must begin at 0 or later, and increase from point to point")
    if times[-1] <= elapsed:
        raise TrajectoryError(
            f"it is over: it started {elapsed:g} s ago and takes {times[-1]:g} s"
            if elapsed > 0.0
            else "it takes no time: a point later than its start is needed"
        )
    if points.shape[1] > 1 and np.abs(points[-1, 1]).max() > _AT_REST:
        raise TrajectoryError(f"it must end at rest; the last point has the velocities {points[-1, 1].tolist()}")
    passed = int(np.searchsorted(times, elapsed, side="right"))
    if passed:
        check_start(passed, points[passed - 1, 0], present[0], tolerance)
    return interpolate(np.concatenate([[elapsed], times[passed:]]), points[passed:], present, interpolation)


def check_start(number: int, due: Array, present: Array, tolerance: float) -> None:
    """Check that the reference can go on from a point that is due now.

    Args:
        number: of the point, from 1.
        due: its position, shape (joints,), rad.
        present: position of the reference, shape (joints,), rad.
        tolerance: largest distance, rad.

    Raises:
        StartError: it is farther away.
    """
    if (distance := np.abs(due - present).max()) > tolerance:
        raise StartError(
            f"point {number} is due now, and {distance:.3g} from the present reference "
            f"{present.tolist()}; at most {tolerance:g} is allowed (start_tolerance)"
        )


def interpolate(times: Array, points: Array, start: Array, interpolation: Interpolation = "spline") -> PiecewiseMotion:
    """A motion from a state through points.

    Points with velocities are joined by cubics, with velocities and accelerations by quintics. Positions only are
    joined by a cubic spline whose acceleration is continuous everywhere, also at the start and at the end, where
    velocity and acceleration are zero; its first and last segment are therefore quartics. With ``linear`` they are
    joined by straight lines, except for the first segment, a cubic, because it begins with the velocity of `start`.

    Args:
        times: of start and points, s, increasing, shape (n + 1,).
        points: positions, and velocities and accelerations where given, shape (n, 1 to 3, joints), rad, rad/s, rad/s^2.
        start: q, q', q'' at the first time, shape (3, joints).
        interpolation: what joins points that are positions only.
    """
    count, given, joints = points.shape
    states = np.zeros((count + 1, 3, joints))
    states[0] = start
    states[1:, :given] = points
    durations = np.diff(times)[:, None]
    if given == 1 and interpolation == "spline":
        _smooth(states, durations)
        return PiecewiseMotion(piecewise(times, states[:-1], states[1:]))
    starts, ends = states[:-1].copy(), states[1:].copy()
    if given == 1:
        slopes = np.diff(states[:, 0], axis=0) / durations
        starts[1:, 1] = ends[1:, 1] = slopes[1:]
        if len(slopes) > 1:
            ends[0, 1] = slopes[1]
    curved = {1: 1, 2: count, 3: 0}[given]  # number of cubic segments, counted from the first
    _make_cubic(starts[:curved], ends[:curved], durations[:curved])
    return PiecewiseMotion(piecewise(times, starts, ends))


def _make_cubic(starts: Array, ends: Array, durations: Array) -> None:
    """Write accelerations that make the quintics between these states, shape (n, 3, joints), cubics."""
    chords = (ends[:, 0] - starts[:, 0]) / durations
    starts[:, 2] = (6.0 * chords - 4.0 * starts[:, 1] - 2.0 * ends[:, 1]) / durations
    ends[:, 2] = (-6.0 * chords + 2.0 * starts[:, 1] + 4.0 * ends[:, 1]) / durations


def _smooth(states: Array, durations: Array) -> None:
    """Write velocities and accelerations of a spline to the inner states, shape (n + 1, 3, joints).

    With chord c and duration h, a cubic has the acceleration (6 c - 4 v0 - 2 v1) / h at its begin. A quartic with zero
    acceleration at its end has (12 c - 6 v0 - 6 v1) / h. Backwards in time, the same holds for the ends of segments.
    That both segments at an inner point have the same acceleration gives a tridiagonal system for the velocities.
    """
    n = len(durations)
    if n == 1:
        return
    far, near = np.full((n, 1), 4.0), np.full((n, 1), 2.0)
    far[[0, -1]] = near[[0, -1]] = 6.0
    far, near = far / durations, near / durations
    pull = (far + near) * np.diff(states[:, 0], axis=0) / durations
    right = pull[:-1] + pull[1:]
    right[0] -= states[0, 2] + near[0] * states[0, 1]
    bands = np.zeros((3, n - 1))
    bands[0, 1:] = bands[2, :-1] = near[1:-1, 0]
    bands[1] = far[:-1, 0] + far[1:, 0]
    states[1:-1, 1] = solve_banded((1, 1), bands, right)
    states[1:-1, 2] = pull[1:] - far[1:] * states[1:-1, 1] - near[1:] * states[2:, 1]
