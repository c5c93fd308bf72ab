"""Coming to rest in the shortest time."""

from ruckig import ControlInterface, InputParameter, Synchronization

from pidtsm_core.parameters import Array
from pidtsm_core.trajectories.jerk_limited import fastest
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.motion import PiecewiseMotion


def stop(present: Array, limits: MotionLimits) -> PiecewiseMotion:
    """The motion from a state at time 0 to rest.

    Each joint comes to rest as fast as its limits of acceleration and jerk allow. The acceleration is continuous.

    Args:
        present: q, q', q'', shape (3, joints), rad, rad/s, rad/s^2; the acceleration may exceed its limit.
        limits: of the arm.
    """
    joints = len(limits.joints)
    given = InputParameter(joints)
    given.control_interface = ControlInterface.Velocity
    given.synchronization = Synchronization.No
    given.current_position, given.current_velocity, given.current_acceleration = present.tolist()
    given.target_velocity = given.target_acceleration = [0.0] * joints
    given.max_acceleration, given.max_jerk = limits.acceleration.tolist(), limits.jerk.tolist()
    return fastest(given)
