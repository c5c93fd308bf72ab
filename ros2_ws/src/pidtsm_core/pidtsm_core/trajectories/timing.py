"""Fast motions through way points that have no times."""

import numpy as np
from ruckig import InputParameter

from pidtsm_core.parameters import Array
from pidtsm_core.trajectories.jerk_limited import fastest
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.motion import PiecewiseMotion


def retime(waypoints: Array, limits: MotionLimits) -> PiecewiseMotion:
    """A motion from rest at the first way point to rest at the last one, within all limits (see `checking.check`).

    Args:
        waypoints: shape (n, joints), rad or m.
        limits: of the arm.

    Returns:
        A motion that begins at time 0.

    Raises:
        TrajectoryError: a way point is outside the limits, or gravity alone exceeds the limits of effort there.
    """
    joints = len(limits.joints)
    given = InputParameter(joints)
    given.current_position, given.target_position = waypoints[0].tolist(), waypoints[-1].tolist()
    given.max_velocity = np.minimum(limits.velocity, 1e3).tolist()
    given.max_acceleration, given.max_jerk = limits.acceleration.tolist(), limits.jerk.tolist()
    return fastest(given)
