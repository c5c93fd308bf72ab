"""Fastest motions with limited jerk, computed by ruckig (Berscheid and Kröger, RSS 2021)."""

from itertools import accumulate

import numpy as np
from ruckig import InputParameter, Result, Ruckig, RuckigError, Trajectory

from pidtsm_core.arrays import Array
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.motion import PiecewiseMotion

_SHORTEST = 1e-9
"""Shorter segments are left out, s."""


def fastest(given: InputParameter) -> PiecewiseMotion:
    """The fastest motion from a state at time 0 to rest.

    Raises:
        TrajectoryError: ruckig finds none.
    """
    found, joints = Trajectory(given.degrees_of_freedom), given.degrees_of_freedom
    try:
        result = Ruckig(joints).calculate(given, found)
    except (RuckigError, ValueError) as error:  # ValueError: a result that the module does not know, such as -101.
        raise TrajectoryError(f"no motion to rest is possible: {error}") from None
    if result not in (Result.Working, Result.Finished):
        raise TrajectoryError(f"no motion to rest is possible ({result.name}): {given}")
    ends = [0.0]
    for profile in found.profiles[0]:
        ends += accumulate((profile.brake.duration - sum(profile.brake.t), *profile.brake.t, *profile.t))
    times = np.unique(np.array(ends))
    times = times[np.concatenate([[True], np.diff(times) > _SHORTEST])]
    if times.size == 1:
        times = np.array([0.0, _SHORTEST])
    return _cubics(times, np.array([found.at_time(float(t)) for t in times]))


def fastest_line(start: Array, end: Array, velocity: Array, acceleration: Array, jerk: Array) -> PiecewiseMotion:
    """The fastest motion on a straight line, from rest to rest; to stay there if it has no length.

    It is computed as that of one joint from 0 to 1, in a unit of time in which the smallest of its limits is 1: numbers
    of that size suit ruckig for a line of any length.

    Args:
        start: shape (joints,), rad or m.
        end: likewise.
        velocity: limits, shape (joints,), rad/s or m/s.
        acceleration: likewise, rad/s^2 or m/s^2.
        jerk: likewise, rad/s^3 or m/s^3.

    Raises:
        TrajectoryError: ruckig finds none.
    """
    way = end - start
    if not way.any():
        return _cubics(np.array([0.0, _SHORTEST]), np.array([[start, 0.0 * way, 0.0 * way]] * 2))
    moves = way != 0.0
    limits = [float((limit[moves] / np.abs(way[moves])).min()) for limit in (velocity, acceleration, jerk)]
    unit = max(limit ** (-1.0 / order) for order, limit in enumerate(limits, start=1))
    given = InputParameter(1)
    given.current_position, given.target_position = [0.0], [1.0]
    scaled = [limit * unit**order for order, limit in enumerate(limits, start=1)]
    (given.max_velocity, given.max_acceleration, given.max_jerk) = ([limit] for limit in scaled)
    line = fastest(given)
    coefficients = way[:, np.newaxis, np.newaxis] * line.coefficients
    coefficients[..., 0] += start[:, np.newaxis]
    times = np.tile(unit * line.times, (way.size, 1))
    return PiecewiseMotion(np.hstack([times, coefficients.reshape(way.size, -1)]))


def _cubics(times: Array, states: Array) -> PiecewiseMotion:
    """The motion whose acceleration is linear between these states, shape (n, 3, joints), the last of which rests."""
    states[-1, 1:] = 0.0
    durations = np.diff(times)[:, None]
    q, dq, ddq = states.transpose(1, 0, 2)
    coefficients = np.zeros((len(durations), 6, q.shape[1]))
    coefficients[:, 0] = q[:-1]
    coefficients[:, 1] = dq[:-1] * durations
    coefficients[:, 2] = ddq[:-1] * durations**2 / 2.0
    coefficients[:, 3] = np.diff(ddq, axis=0) * durations**2 / 6.0
    flat = coefficients.transpose(2, 0, 1).reshape(q.shape[1], -1)
    return PiecewiseMotion(np.hstack([np.tile(times, (q.shape[1], 1)), flat]))
