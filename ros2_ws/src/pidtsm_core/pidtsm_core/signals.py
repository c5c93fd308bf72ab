"""Rows of a controller's table of signals, shape (len(Signal), joints): its values at one sample.

The names are those of the fields of pidtsm_msgs/ControllerState.
"""

from enum import IntEnum


class Signal(IntEnum):
    """Rows of `Recording.signals`, with the units of a joint that turns."""

    POSITION = 0  # estimated q, rad
    VELOCITY = 1  # estimated q', rad/s
    ACCELERATION = 2  # estimated q'', rad/s^2
    POSITION_ERROR = 3  # e = q - q_d, rad, eq. (7)
    VELOCITY_ERROR = 4  # e', rad/s, eq. (8)
    SLIDING_VARIABLE = 5  # s, eq. (11)
    MANIFOLD_VARIABLE = 6  # sigma, eq. (10)
    ADAPTIVE_GAIN = 7  # Y, eq. (27)
    SWITCHING_TERM = 8  # tau_sw in the unit of sigma, per s without a manifold, eq. (25)
    ACCELERATION_COMMAND = 9  # a_cmd, rad/s^2
    EQUIVALENT_EFFORT = 10  # a_cmd without the switching term, as torque, N m: -phi^-1 tau_eq of eq. (20)
    EFFORT = 11  # commanded effort within the limits, N m
    SATURATED = 12  # what limits the effort: 0 nothing, 1 its limit, 2 the limit of its rate, 3 both


class Status(IntEnum):
    """Places of the integers of a controller's status at one sample, shape (len(Status),).

    The names are those of the fields of pidtsm_msgs/ControllerState, and so are the values.
    """

    MODE = 0  # see `Mode`
    FAULT = 1  # see `Fault`
    FAULT_JOINT = 2  # the joint that caused the fault, counted from 1; 0: no single joint
    VIOLATIONS = 3  # limits that are exceeded, see `Violation`
    STOP_STAGE = 4  # see `Stop`


class Mode(IntEnum):
    """What the controller does."""

    FOLLOWING = 0  # the reference
    HOLDING = 1  # its position: the reference is missing or too old, or it was requested
    STOPPED = 2  # applies the safe effort after a fault
    FREEDRIVE = 3  # carries the arm, and lets a person move it


class Request(IntEnum):
    """What the controller shall do while there is no fault."""

    FOLLOW = 0  # the reference
    HOLD = 1  # its position, whatever the reference is
    FREE = 2  # freedrive


class Fault(IntEnum):
    """Reason why the controller stopped."""

    NO_FAULT = 0
    STATE_STALE = 1
    POSITION_LIMIT = 2
    VELOCITY_LIMIT = 3
    TRACKING_LIMIT = 4
    EFFORT_RATE_LIMIT = 5
    MEASUREMENT = 6
    EXTERNAL_EFFORT_LIMIT = 7
    NO_EFFECT = 8


class Stop(IntEnum):
    """How a controller that has stopped keeps the arm safe: the first stage trusts most, the last one least."""

    NONE = 0  # not stopped, or ``stop.effort`` is not ``hold``
    HOLD = 1  # holds the arm where it stopped
    DAMPING = 2  # damps it: it left its place
    GRAVITY = 3  # carries it, and damps it weakly: it grew faster although it was damped
    BLIND = 4  # applies the effort of the model while no joint state arrives; this effort fades


class Violation(IntEnum):
    """Limits that a joint exceeds, as powers of two; combinations are sums."""

    POSITION = 1
    VELOCITY = 2
    TRACKING = 4
    EXTERNAL_EFFORT = 8


class Limited(IntEnum):
    """What limits a joint's effort, in `Signal.SATURATED`; combinations are sums."""

    EFFORT = 1
    RATE = 2
    BARRIER = 4  # it keeps the joint before a limit of its motion


class Adaptation(IntEnum):
    """What the law may adapt."""

    NORMAL = 0
    APPROACHING = 1  # during the approach to a reference, where the sliding variables are small from the start
    FROZEN = 2  # during an approach because the effort was limited: the errors are not due to disturbances
