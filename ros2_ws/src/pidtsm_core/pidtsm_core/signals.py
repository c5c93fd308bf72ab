"""The rows of a controller's signal table, shape (len(Signal), joints): what it computed at one sample.

The names are those of the fields of pidtsm_msgs/ControllerState.
"""

from enum import IntEnum


class Signal(IntEnum):
    """Row numbers; units in the comments."""

    POSITION = 0  # estimated q, rad
    VELOCITY = 1  # estimated q', rad/s
    ACCELERATION = 2  # estimated q'', rad/s^2
    POSITION_ERROR = 3  # e = q - q_d, rad, eq. (7)
    VELOCITY_ERROR = 4  # e', rad/s, eq. (8)
    SLIDING_VARIABLE = 5  # s, eq. (11)
    MANIFOLD_VARIABLE = 6  # sigma, eq. (10)
    ADAPTIVE_GAIN = 7  # Y, eq. (27)
    SWITCHING_TERM = 8  # tau_sw in the unit of sigma, eq. (25)
    ACCELERATION_COMMAND = 9  # a_cmd, rad/s^2
    EQUIVALENT_EFFORT = 10  # a_cmd without the switching term, as torque, N m: -phi^-1 tau_eq of eq. (20)
    EFFORT = 11  # commanded torque within the limits, N m
    SATURATED = 12  # 1 where the torque is at its limit, else 0
