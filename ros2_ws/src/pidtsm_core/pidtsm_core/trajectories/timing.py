"""Fast motions through way points that have no times."""

import math

import numpy as np
from ruckig import InputParameter, Synchronization
from scipy.interpolate import CubicSpline

from pidtsm_core.parameters import Array
from pidtsm_core.trajectories.checking import check, excessive_effort
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.interpolation import interpolate
from pidtsm_core.trajectories.jerk_limited import fastest
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.motion import PiecewiseMotion

_FASTEST = 1e3
"""Largest velocity of a joint without a limit, rad/s or m/s."""
_KNOTS = 24
"""Largest number of durations that are adapted independently; those between them follow smoothly."""
_SAME = 1e-9
"""Way points closer to each other count once, rad or m."""
_ROUNDS = 60
"""How often the durations of all segments are adapted."""
_STEP = 1.05
"""Factor by which a motion is slowed down until the efforts suffice."""
_SLOWEST = 60
"""How often at most; what is 1.05^60 = 19 times slower needs no more effort than gravity does."""


def retime(waypoints: Array, limits: MotionLimits) -> PiecewiseMotion:
    """A fast motion from rest at the first way point to rest at the last one, within all limits.

    With two way points it is the fastest motion on the straight line between them. With more it passes through all of
    them on a spline (see `interpolate`) without stopping; the durations of its segments are adapted so that a limit of
    velocity, acceleration or jerk is reached nearly everywhere. If it needs too much effort, it is slowed down as a
    whole.

    Args:
        waypoints: shape (n, joints), rad or m.
        limits: of the arm.

    Returns:
        A motion that begins at time 0.

    Raises:
        TrajectoryError: a number is not finite, or the motion leaves the position limits, or gravity alone needs more
            effort than is allowed.
    """
    if not np.isfinite(waypoints).all():
        raise TrajectoryError("a way point contains a number that is not finite")
    moves = np.abs(np.diff(waypoints, axis=0)).max(axis=1) > _SAME
    waypoints = waypoints[np.concatenate([[True], moves])]
    motion = _on_a_line(waypoints, limits) if len(waypoints) <= 2 else _on_a_spline(waypoints, limits)
    for _ in range(_SLOWEST):
        if excessive_effort(motion, limits) is None:
            break
        motion = motion.stretched(_STEP)
    check(motion, limits)
    return motion


def _on_a_line(waypoints: Array, limits: MotionLimits) -> PiecewiseMotion:
    """The fastest motion between two way points; of one, to stay there."""
    given = InputParameter(len(limits.joints))
    given.synchronization = Synchronization.Phase
    given.current_position, given.target_position = waypoints[0].tolist(), waypoints[-1].tolist()
    given.max_velocity = np.minimum(limits.velocity, _FASTEST).tolist()
    given.max_acceleration, given.max_jerk = limits.acceleration.tolist(), limits.jerk.tolist()
    return fastest(given)


def _on_a_spline(waypoints: Array, limits: MotionLimits) -> PiecewiseMotion:
    """A motion through at least three way points, of which neighbours differ.

    The durations of its segments are those of a minimum-jerk motion along the path, times factors that vary smoothly:
    each round increases the factor where a limit is nearest, and slows the whole motion down until it keeps all limits.
    """
    start = np.zeros((3, waypoints.shape[1]))
    start[0] = waypoints[0]
    durations, middles = _minimum_jerk(waypoints, limits)
    index = np.arange(len(durations))
    count = min(len(durations), _KNOTS)
    knots = np.interp(np.linspace(0, index[-1], count), index, middles)
    spread = CubicSpline(knots, np.eye(count), bc_type="natural")(middles)
    nearest = np.abs(middles[:, None] - knots).argmin(axis=1)
    factors = np.zeros(count)  # logarithms, at the knots
    fastest_yet: PiecewiseMotion | None = None
    for turn in range(_ROUNDS):
        times = np.concatenate([[0.0], np.cumsum(durations * np.exp(spread @ factors))])
        motion = interpolate(times, waypoints[1:, None], start)
        excess = _excess(motion, limits)
        motion = motion.stretched(float(excess.max()))
        if fastest_yet is None or motion.end < fastest_yet.end:
            fastest_yet = motion
        of_knots = np.full(count, 1e-3 * excess.max())
        np.maximum.at(of_knots, nearest, excess)
        factors += 0.5 * (1.0 - turn / _ROUNDS) * np.log(of_knots / of_knots.max())
    assert fastest_yet is not None
    return fastest_yet


def _minimum_jerk(waypoints: Array, limits: MotionLimits) -> tuple[Array, Array]:
    """Durations of the segments of a minimum-jerk motion of 1 s along the path, and the middles of the segments."""
    distances = np.abs(np.diff(waypoints, axis=0))
    lengths = np.maximum(distances / limits.velocity, 0.1 * np.sqrt(distances / limits.acceleration)).max(axis=1)
    t = np.linspace(0.0, 1.0, 2001)
    passed = np.concatenate([[0.0], np.cumsum(lengths) / lengths.sum()])
    times = np.interp(passed, t**3 * (10.0 - t * (15.0 - 6.0 * t)), t)
    return np.diff(times), 0.5 * (times[1:] + times[:-1])


def _excess(motion: PiecewiseMotion, limits: MotionLimits) -> Array:
    """Factor by which each segment must last longer to keep the limits, shape (segments,).

    Derivatives are bounded by their Bernstein coefficients, so the factor is a little larger than necessary.
    """
    powers, durations = motion.coefficients, np.diff(motion.times)
    result = np.zeros(len(durations))
    for order, limit in enumerate((limits.velocity, limits.acceleration, limits.jerk), start=1):
        powers = powers[..., 1:] * np.arange(1, powers.shape[-1])
        bound = np.abs(powers @ _bernstein(powers.shape[-1]).T).max(axis=-1) / durations**order
        result = np.maximum(result, (bound / limit[:, None]).max(axis=0) ** (1.0 / order))
    return result


def _bernstein(count: int) -> Array:
    """The matrix that turns coefficients of the powers 0 to count - 1 into Bernstein coefficients."""
    degree = count - 1
    return np.array([[math.comb(i, j) / math.comb(degree, j) for j in range(count)] for i in range(count)])
