"""Configuration and state of the controller, in memory that compiled code finds by address."""

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import PartOf
from pidtsm_core.compiling.memory import Layout
from pidtsm_core.control.bank import Bank
from pidtsm_core.control.compliance_parameters import Compliance, new_compliance
from pidtsm_core.control.configuration import ControllerConfig, example_config
from pidtsm_core.control.late_drives import late_drives
from pidtsm_core.control.rests import Rests, new_rests
from pidtsm_core.laws import STATE_SLOTS, Demand
from pidtsm_core.parameters.family import SLOTS
from pidtsm_core.signals import Signal, Status


class Time(IntEnum):
    """Indices of the times that a step changes, ns."""

    LAST = 0  # stamp of the last joint state that was answered
    BEGAN = 1  # stamp of the first joint state since the controller was reset, plus 1; 0: none so far
    APPROACH_BEGAN = 2  # stamp at which the approach began, see desired.py
    GAP = 3  # time without a joint state before the last command
    REFERENCE_AGE = 4  # age of the reference at the last joint state; negative: it is ahead
    BEHIND_SINCE = 5  # stamp since which the rate limit has delayed the effort, plus 1; 0: it does not
    PERIOD = 6  # nominal time between two joint states; 0: not known yet
    SENT = 7  # time of the last command, in the time of the stamps
    SILENT_SINCE = 8  # when joint states were found missing, in the time of the stamps, plus 1; 0: they arrive
    FREED = 9  # stamp at which freedrive began, plus 1; 0: it has not
    NOTED = 10  # time of the newest row of the history, in the time of the stamps
    DEGRADED_SINCE = 11  # since when the stopped arm has not obeyed, plus 1; 0: it does, see supervision.py


class Count(IntEnum):
    """Indices of the numbers that a step counts."""

    ANSWERED = 0  # number of joint states answered since the controller started afresh
    LATE = 1  # number of joint states that were late, see watchdog.state_hold
    AT_EFFORT_LIMIT = 2  # number of steps with a joint at its effort limit
    AT_RATE_LIMIT = 3  # number of steps with a joint at its rate limit
    IMPLAUSIBLE = 4  # number of joint states with an implausible measurement
    NOTES = 5  # number of rows written to the history
    RESTED = 6  # number of times that a stopped arm was held again after it had left its place


class Condition(IntEnum):
    """Indices of what is so, or not, and of choices among a few."""

    REHEARSED_RESET = 0  # 1: done
    REHEARSED_RESTART = 1  # 1: done
    COMMANDED = 2  # 1: there was a command since the controller was reset
    ADAPTATION = 3  # see `Adaptation`
    STRAYED = 4  # 1: because of a rate limit, the arm has left its reference and is on its way back
    HELD = 5  # where a controller that has stopped holds the arm, see `Held`
    BRAKES = 6  # 1: the brakes should be engaged
    REQUEST = 7  # see `Request`
    GENTLE = 8  # 1: the next approach keeps within freedrive.velocity, because the arm may be far from its reference
    HANDOVER = 9  # what a change of the controller does to the effort, see `Handover`
    UNLIMITED = 10  # 1: the rate limit is suspended, because it would prevent the stop
    SLEWING = 11  # 1: the safe effort of the last step was limited by its largest change
    YIELDS = 12  # 1: the reference has yielded to what acts from outside, see compliance.py


class Handover(IntEnum):
    """Values of `Condition.HANDOVER`."""

    NONE = 0
    PENDING = 1  # the next effort shall be that of the last command
    FADING = 2  # the difference fades


class Held(IntEnum):
    """Values of `Condition.HELD`."""

    NOT = 0
    HERE = 1  # at the end of its way to rest
    ELSEWHERE = 2  # the arm may have moved since, and will be held at its new position
    UNSEEN = 3  # there was no joint state for a while; an arm that is near its place will be held there


class Hold(IntEnum):
    """Rows of the state of a controller that holds the arm, per joint."""

    INTEGRAL = 0  # of the error, rad s
    VELOCITY = 1  # filtered, rad/s
    POSITION = 2  # as measured last, rad
    LEARNT = 3  # effort that the law had learnt to add to the model's, N m
    OFFSET = 4  # what is left of the difference between the last command before the stop and the first safe one, N m
    ANCHOR = 5  # where freedrive, or the damping of a stopped arm, ties the arm, rad
    INERTIA = 6  # what a push moves in freedrive while the other joints hold still, kg m^2
    LIGHTEST = 7  # the same while they are loose, kg m^2
    SLIP = 8  # velocity of the anchor, filtered, rad/s
    SLOWEST = 9  # least speed since the controller has only damped the arm, rad/s
    DISTRUSTED = 10  # 1: the measurements of the joint are not used, see trust.py
    BLIND = 11  # time since it has been distrusted, s
    STEADY = 12  # time for which its measurements have not jumped, s
    STEADY_FROM = 13  # its measured position then, rad
    BEFORE = 14  # its velocity when the arm was stopped, rad/s
    SEEN = 15  # last measured position, rad
    SIGN = 16  # 1, -1: its motion is measured with this sign, its position not at all; 0: its position is measured
    SHIFT = 17  # its position is SIGN times the measured one, plus this, rad
    TREND = 18  # velocity beside the desired one, filtered more, rad/s
    REVERSED = 19  # how often SIGN was changed
    WEIGHED = 20  # time for which its load has been weighed, s
    NET = 21  # effort beyond what the model needs at rest, filtered as its velocity, N m
    LAST = 22  # its velocity at the last sample, rad/s
    DAMPED = 23  # 1: SIGN was changed because damping has accelerated it
    DROPPED = 24  # what of LEARNT was dropped because it drove the joint away, N m


class Still(IntEnum):
    """Rows of what is known of a joint whose measured position does not change by a single bit, see effect.py."""

    POSITION = 0  # as measured last, rad
    SAMPLES = 1  # number of consecutive measurements that equal it
    EFFORT = 2  # commanded when it began, N m
    DEMANDED = 3  # effort beyond that of the model then, N m


class External(IntEnum):
    """Rows of the effort that acts on the arm from outside, per joint, N m, see contact.py."""

    ONCE = 0  # averaged once
    TWICE = 1  # averaged twice: noise of the position is differentiated twice
    USUAL = 2  # the same when the arm was last near its reference
    CHANGE = 3  # since then
    MOVING = 4  # as USUAL, when the joint last moved along with its reference
    DIRECTION = 5  # in which it moved then, 1 or -1; 0: it has not moved
    BEHIND = 6  # rad or m; what the desired position pulls behind it
    NOW = 7  # not averaged


class Friction(IntEnum):
    """Rows of what is known of the friction beyond ``compensation``, per joint; see friction_learning.py."""

    COULOMB = 0  # N m
    DEVIATION = 1  # its standard deviation, N m
    VISCOUS = 2  # N m s/rad
    USED = 3  # Coulomb friction that is compensated, N m
    EFFORT = 4  # that compensates it at this sample, N m
    EVIDENCE = 5  # for how long it was observed, s
    SQUARES = 6  # integral of the square of the effort that the model lacks, (N m)^2 s
    MIDDLE = 7  # the part of COULOMB that grows with the velocity, N m
    SOFT = 8  # the part of COULOMB that grows slowly with it, N m
    MIDDLE_SHARE = 9  # share of the former of USED
    SOFT_SHARE = 10  # share of the latter
    LEFT = 11  # slow part of what the fit leaves unexplained, N m
    SLOW = 12  # integral of its square, (N m)^2 s
    FORTH = 13  # for how long the joint was observed moving forwards, s
    BACK = 14  # likewise, backwards


class Noise(IntEnum):
    """Rows of what is known of the noise of a measured position, see lacking.py."""

    ERROR = 0  # of the estimated position at the last sample, rad
    VARIANCE = 1  # rad^2
    LATELY = 2  # largest variance lately, rad^2: the steps of a coarse encoder are rare while it moves slowly
    CORRECTION = 3  # what corrects the estimated velocity, rad/s


class Softness(IntEnum):
    """Rows of what is known of the roughness of a joint's command, see softening.py."""

    SENT = 0  # the last command, N m
    TREND = 1  # its change from sample to sample, filtered, as a share of the effort limit
    ROUGHNESS = 2  # mean of what the change is beyond that, likewise
    ASTRAY = 3  # mean of the estimated error, rad


FITTED = 7
"""Number of coefficients that friction is fitted with."""


class ControllerState(NamedTuple):
    """What a step changes; initially all zero."""

    times: NDArray[np.int64]  # shape (len(Time),), see `Time`
    counts: NDArray[np.int64]  # shape (len(Count),), see `Count`
    conditions: NDArray[np.int64]  # shape (len(Condition),), see `Condition`
    status: NDArray[np.int64]  # shape (len(Status),)
    history_stamps: NDArray[np.int64]  # of the rows of the history, shape (HISTORY,)
    measured: Array  # q as measured, written before a step, shape (joints,), rad
    applied: Array  # effort as the drives report it, if the configuration feeds_back, likewise, N m
    reference: Array  # q_d, q_d', q_d'' as received, written before a step, shape (3, joints)
    feedforward: Array  # effort of the reference as received, likewise, shape (joints,), N m
    given: Array  # values of a reference: `reference` and `feedforward`, shape (4, joints)
    held: Array  # desired motion while no reference is followed, likewise
    base: Array  # scratch: the reference at the sample, or the held position, likewise
    desired: Array  # the same plus the approach: the motion that the law follows, likewise
    approach: Array  # coefficients of the approach, see desired.py, shape (6, joints)
    approach_duration: Array  # shape (1,), s; 0: there is no approach
    braking: Array  # coefficients of its first part, likewise
    braking_duration: Array  # shape (1,), s; 0: there is no such part
    hold_pace: Array  # shape (1,), s in which an effort fades at the begin of a stop, see safe.py
    hold_energy: Array  # shape (1,), J, the least kinetic energy since the controller has only damped the arm
    hold_bandwidth: Array  # shape (1,), rad/s, that of the configuration or as much as the rate of the samples allows
    estimator: Array  # shape (joints, SLOTS), and the rows of `Estimator.rows`
    law: Array  # shape (joints, STATE_SLOTS)
    law_memory: Array  # of a law of the whole arm, shape (`Law.memory`,)
    demand: Array  # what such a law demanded last, see `Demand`, shape (len(Demand), joints)
    frozen: Array  # scratch: 1 for a joint in which nothing may wind up, shape (joints,)
    inertia: Array  # of the model where the arm was stopped, shape (joints, joints), kg m^2
    signals: Array  # shape (len(Signal), joints), see `Signal`
    sent: Array  # the last effort that the drives shall deliver, shape (joints,), N m
    added: Array  # effort of the last tick beyond the law's: it compensates friction, or was fed forward, likewise
    turned: Array  # whole turns that are added to the reference of a continuous joint, shape (joints,), rad
    referred: Array  # position of the last reference that was followed, with these turns, shape (joints,), rad
    output: Array  # the command for the arm, shape (joints,), N m
    implausible: Array  # number of consecutive implausible measurements, shape (joints,)
    feedforward_effort: Array  # effort of the reference that is added now, see desired.py, shape (joints,), N m
    feedforward_before: Array  # the same when the approach began
    freedrive_effort: Array  # what is added because it held the arm at the end of freedrive, likewise
    freedrive_before: Array  # the same when the approach began
    hold: Array  # of the safe effort that holds the arm, see `Hold`, shape (len(Hold), joints)
    still: Array  # of joints whose measurements do not change, see `Still`, shape (len(Still), joints)
    history: Array  # positions as measured, a ring, see history.py, shape (HISTORY, joints), rad
    history_efforts: Array  # commanded before these measurements, likewise, N m
    handover: Array  # what is left of the difference that a change of the controller made, shape (joints,), N m
    external: Array  # effort that acts on the arm from outside, see `External`, shape (len(External), joints)
    friction: Array  # what is known of it, see `Friction`, shape (len(Friction), joints)
    lacking: Array  # effort that the model lacks, see lacking.py, shape (joints,), N m
    learnt_velocity: Array  # velocity for what is learnt, likewise, rad/s
    noise: Array  # of the measured positions, see `Noise`, shape (len(Noise), joints)
    friction_inputs: Array  # filtered regressors, a row for each filter, see friction_learning.py
    friction_evidence: Array  # normal equations: FITTED rows for each joint, shape (FITTED joints, FITTED + 1)
    friction_fit: Array  # coefficients of the fit, and what it leaves unexplained (N m), shape (joints, FITTED + 1)
    friction_solution: Array  # scratch: their factor and solutions, shape (FITTED + 2, FITTED)
    pressed: Array  # part of the compensated friction that the error adds, see joint_friction.py, shape (joints,), N m
    commanded: Array  # `sent`, with what makes up for the lag of the drives, shape (joints,), N m
    drive: Array  # effort that the drives deliver for the last command, when it acts, shape (joints,), N m
    under_way: Array  # commands that may be under way, a ring, see `UnderWay`, shape (MOST_UNDER_WAY, 3, joints)
    under_way_held: Array  # for how long each of them was held, shape (MOST_UNDER_WAY,), s
    under_way_newest: NDArray[np.int64]  # which of them is the newest, shape (1,)
    delivered: Array  # effort that acted before the sample, by the model of the drives, shape (joints,), N m
    damped: Array  # what viscous friction beyond its compensation adds to it, by the parameters, likewise
    undamped: Array  # effort that makes up for it when the command acts, likewise
    predicted: Array  # motion when the command acts, see `Predicted`, shape (len(Predicted), joints)
    ahead: Array  # desired motion then, shape (3, joints)
    lateness: Array  # what is known of it, see `Lateness`
    bank: Bank  # hypotheses about the lateness
    compliance: Compliance  # by how much the reference has yielded
    softness: Array  # what is known of the roughness of each joint, see `Softness`, shape (len(Softness), joints)
    softened: Array  # logarithm of how much slower the arm follows, shape (1,)
    spared: Array  # by how much less it may be softened, because it has strayed, likewise
    pace: Array  # how fast the time of law and observer passes therefore, see softening.py, shape (1,)
    rejected: Array  # disturbance that the law rejects, an acceleration, shape (joints,), rad/s^2
    rests: Rests  # what is known of joints that rest
    truth: Array  # true q', q'' in a simulation, shape (2, joints), rad/s, rad/s^2
    torque: Array  # scratch of a simulation, shape (joints,), N m
    received: Array  # values of a joint state: `measured`, and `applied` if it is used, shape (1 or 2, joints)
    accelerations: Array  # scratch: a_eq, a_cmd, shape (2, joints)
    motion: Array  # scratch: the same and the estimated q'', shape (3, joints)
    scratch: Array  # shape (6, joints)
    net: Array  # scratch: effort that accelerates the arm, shape (joints,), N m


def arrays_of(state: ControllerState) -> list[NDArray[Any]]:
    """Every array of the state, also those of its groups, of any shape."""
    return [array for each in state for array in (each if isinstance(each, tuple) else (each,))]


HISTORY = 16
"""Rows of the history of measured positions."""


class ControllerMemory(NamedTuple):
    """All that the controller's compiled code reads and changes."""

    config: ControllerConfig
    state: ControllerState
    effort: Array  # result for Python, shape (joints,), N m
    signals: Array  # likewise, shape (len(Signal), joints), rows of any distance: those of a message


def _learnt(joints: int) -> dict[str, Any]:
    """The arrays of lacking.py and friction_learning.py, by name; shapes as in `ControllerState`."""
    return {
        "pressed": np.zeros(joints),
        "friction": np.zeros((len(Friction), joints)),
        "lacking": np.zeros(joints),
        "learnt_velocity": np.zeros(joints),
        "noise": np.zeros((len(Noise), joints)),
        "friction_inputs": np.zeros((5, (FITTED + 1) * joints)),
        "friction_evidence": np.zeros((FITTED * joints, FITTED + 1)),
        "friction_fit": np.zeros((joints, FITTED + 1)),
        "friction_solution": np.zeros((FITTED + 2, FITTED)),
    }


def _numbers(*names: str) -> dict[str, Any]:
    """Arrays of one number, by name."""
    return {name: np.zeros(1) for name in names}


def _approach(joints: int) -> dict[str, Any]:
    """The arrays of desired.py, by name; shapes as in `ControllerState`."""
    efforts = ("feedforward_effort", "feedforward_before", "freedrive_effort", "freedrive_before")
    return {
        "approach": np.zeros((6, joints)),
        "approach_duration": np.zeros(1),
        "braking": np.zeros((6, joints)),
        "braking_duration": np.zeros(1),
        **{name: np.zeros(joints) for name in efforts},
    }


def new_state(joints: int, feeds_back: bool, law_memory: int = 0, estimator_rows: int = 0) -> ControllerState:
    """The state of a controller that has not begun.

    Args:
        joints: number of joints.
        feeds_back: as in its configuration.
        law_memory: how many numbers its law keeps, see `Law.memory`.
        estimator_rows: rows of its estimator's state behind those of the joints, see `Estimator.rows`.
    """
    measured, given, motion = np.zeros((2, joints)), np.zeros((4, joints)), np.zeros((3, joints))
    return ControllerState(
        times=np.zeros(len(Time), np.int64),
        counts=np.zeros(len(Count), np.int64),
        conditions=np.zeros(len(Condition), np.int64),
        status=np.zeros(len(Status), np.int64),
        history_stamps=np.zeros(HISTORY, np.int64),
        measured=measured[0],
        applied=measured[1],
        reference=given[:3],
        feedforward=given[3],
        given=given,
        held=np.zeros((3, joints)),
        base=np.zeros((3, joints)),
        desired=np.zeros((3, joints)),
        **_numbers("hold_pace", "hold_energy", "hold_bandwidth"),
        estimator=np.zeros((joints + estimator_rows, SLOTS)),
        law=np.zeros((joints, STATE_SLOTS)),
        law_memory=np.zeros(law_memory),
        demand=np.zeros((len(Demand), joints)),
        frozen=np.zeros(joints),
        **_approach(joints),
        inertia=np.zeros((joints, joints)),
        signals=np.zeros((len(Signal), joints)),
        sent=np.zeros(joints),
        added=np.zeros(joints),
        turned=np.zeros(joints),
        referred=np.zeros(joints),
        output=np.zeros(joints),
        implausible=np.zeros(joints),
        hold=np.zeros((len(Hold), joints)),
        still=np.zeros((len(Still), joints)),
        history=np.zeros((HISTORY, joints)),
        history_efforts=np.zeros((HISTORY, joints)),
        handover=np.zeros(joints),
        external=np.zeros((len(External), joints)),
        **_learnt(joints),
        **late_drives(joints),
        compliance=new_compliance(joints),
        softness=np.zeros((len(Softness), joints)),
        **_numbers("softened", "spared", "pace"),
        rejected=np.zeros(joints),
        rests=new_rests(joints),
        truth=np.zeros((2, joints)),
        torque=np.zeros(joints),
        received=measured[: 1 + feeds_back],
        accelerations=motion[:2],
        motion=motion,
        scratch=np.zeros((6, joints)),
        net=np.zeros(joints),
    )


def _example() -> ControllerMemory:
    """The memory of a controller with one joint."""
    config = example_config()
    apart = np.zeros((len(Signal), 2))[:, :1]
    return ControllerMemory(config, new_state(1, feeds_back=False), np.zeros(1), apart)


LAYOUT = Layout(_example)
memory_at = LAYOUT.at
"""In compiled code, the `ControllerMemory` at an address."""
part = PartOf(lambda: _example().config, lambda: _example().state)
"""Decorates a function of the controller that is compiled on its own, see `PartOf`: what few steps need."""
