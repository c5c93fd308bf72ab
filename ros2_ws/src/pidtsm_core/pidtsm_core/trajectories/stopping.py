"""Coming to rest in the shortest time."""

import numpy as np
from ruckig import ControlInterface, InputParameter, Synchronization

from pidtsm_core.arrays import Array
from pidtsm_core.references.piecewise import piecewise
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.jerk_limited import fastest
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.motion import PiecewiseMotion

_LARGEST = 10.0
"""Acceleration with which a stop may begin, as a multiple of its limit: without a model, anything may be sent."""
_AT_ONCE = 1e-3  # s
_ANY_VELOCITY = 1e3
"""Stands for no limit, rad/s."""


def stop(present: Array, limits: MotionLimits) -> PiecewiseMotion:
    """The motion from a state at time 0 to rest.

    Each joint comes to rest as fast as its limits of acceleration and jerk allow. The acceleration is continuous,
    unless it is beyond ten times its limit. A motion so absurd that no stop can be computed ends at once.

    Args:
        present: q, q', q'', shape (3, joints), rad, rad/s, rad/s^2; the acceleration may exceed its limit.
        limits: of the arm.
    """
    given = _from(present, limits)
    given.control_interface = ControlInterface.Velocity
    try:
        return fastest(given)
    except TrajectoryError:
        joints = len(limits.joints)
        here = np.zeros((1, 3, joints))
        here[0, 0] = present[0]
        return PiecewiseMotion(piecewise(np.array([0.0, _AT_ONCE]), here, here))


def stop_at(position: Array, present: Array, limits: MotionLimits) -> PiecewiseMotion:
    """The motion from a state at time 0 to rest at a position, as fast as velocity, acceleration and jerk allow.

    Args:
        position: shape (joints,), rad.
        present: q, q', q'', shape (3, joints), rad, rad/s, rad/s^2.
        limits: of the arm; other limits, as that of the effort, are not considered.

    Raises:
        TrajectoryError: none is found, as the present state is beyond the limits.
    """
    given = _from(present, limits)
    given.target_position = position.tolist()
    given.max_velocity = np.minimum(limits.planned_velocity, _ANY_VELOCITY).tolist()
    return fastest(given)


def _from(present: Array, limits: MotionLimits) -> InputParameter:
    """A motion of each joint for itself, from a state to rest, within the limits of acceleration and jerk."""
    joints = len(limits.joints)
    given = InputParameter(joints)
    given.synchronization = Synchronization.No
    given.current_position, given.current_velocity, _ = present.tolist()
    largest = _LARGEST * limits.acceleration
    given.current_acceleration = np.clip(present[2], -largest, largest).tolist()
    given.target_velocity = given.target_acceleration = [0.0] * joints
    given.max_acceleration, given.max_jerk = limits.acceleration.tolist(), limits.jerk.tolist()
    return given
