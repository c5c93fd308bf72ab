"""Configuration and state of the controller, and the two arrays that contain them."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.compiled import inlined
from pidtsm_core.family import SLOTS
from pidtsm_core.laws import LAW_INTEGERS, STATE_SLOTS, Integers
from pidtsm_core.parameters import Array
from pidtsm_core.parts import PartOf
from pidtsm_core.robots import Model
from pidtsm_core.signals import Signal, Status


class Clock(IntEnum):
    """Indices of the integers that a step changes; times are in ns."""

    ANSWERED = 0  # number of joint states answered since the controller started afresh
    LAST = 1  # stamp of the last joint state that was answered
    BEGAN = 2  # stamp of the first joint state since the controller was reset, plus 1; 0: none so far
    WAY_BEGAN = 3  # stamp at which the way began, see desired.py
    LATE = 4  # number of joint states that were late, see watchdog.state_hold
    REHEARSED_RESET = 5  # 1: done
    REHEARSED_RESTART = 6  # 1: done
    COMMANDED = 7  # 1: there was a command since the controller was reset
    ADAPTATION = 8  # see `Adaptation`
    GAP = 9  # time without a joint state before the last command
    REFERENCE_AGE = 10  # age of the reference at the last joint state; negative: it is ahead
    AT_EFFORT_LIMIT = 11  # number of steps with a joint at its effort limit
    AT_RATE_LIMIT = 12  # number of steps with a joint at its rate limit
    STRAYED = 13  # 1: because of a rate limit, the arm has left its reference and is on its way back
    BEHIND_SINCE = 14  # stamp since which the rate limit has delayed the effort, plus 1; 0: it does not
    PERIOD = 15  # nominal time between two joint states; 0: not known yet
    SENT = 16  # time of the last command, in the time of the stamps
    IMPLAUSIBLE = 17  # number of joint states with an implausible measurement
    HELD = 18  # where a controller that has stopped holds the arm, see `Held`
    SILENT_SINCE = 19  # when joint states were found missing, in the time of the stamps, plus 1; 0: they arrive
    BRAKES = 20  # 1: the brakes should be engaged
    REQUEST = 21  # see `Request`
    FREED = 22  # stamp at which freedrive began, plus 1; 0: it has not
    GENTLE = 23  # 1: the next approach keeps within freedrive.velocity, because the arm may be far from its reference
    NOTED = 24  # time of the newest row of the history, in the time of the stamps
    NOTES = 25  # number of rows written to the history
    HANDOVER = 26  # what a change of the controller does to the effort, see `Handover`
    DEGRADED_SINCE = 27  # since when the stopped arm has not obeyed, plus 1; 0: it does, see supervision.py
    RESTED = 28  # number of times that a stopped arm was held again after it had left its place
    UNLIMITED = 29  # 1: the rate limit is suspended, because it would prevent the stop
    SLEWING = 30  # 1: the safe effort of the last step was limited by its largest change


class Handover(IntEnum):
    """Values of `Clock.HANDOVER`."""

    NONE = 0
    PENDING = 1  # the next effort shall be that of the last command
    FADING = 2  # the difference fades


class Held(IntEnum):
    """Values of `Clock.HELD`."""

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


class ControllerConfig(NamedTuple):
    """What a step reads. The estimator is its index in `ESTIMATORS`; a limit of 0 means no limit."""

    estimator: int
    uses_model: bool
    freezes: bool  # integrals and adaptation of a joint pause while its effort is limited
    stops: int  # violations that are faults, see `Violation`
    state_hold: int  # ns
    state_stop: int  # ns
    reference_timeout: int  # ns
    reset_at: int  # ns from the first joint state, 0: never
    restart_at: int  # ns from the first joint state, 0: never
    rate_limited: bool  # a joint has a rate limit
    feeds_back: bool  # the applied effort is measured
    watches: bool  # a joint has a limit of position, velocity or error
    rehearses: bool  # a reset or a restart is rehearsed
    holds: bool  # the safe effort holds the arm where it stopped
    brakes: bool  # the arm has brakes, to be engaged when it has stopped
    compensates: bool  # a joint has friction that is compensated
    rejects: bool  # the disturbance that the observer estimates is subtracted from the law's acceleration
    doubts: bool  # the measurements of a joint are checked for plausibility
    turns: bool  # a joint is continuous
    feels: bool  # a joint has a limit of the external effort
    robot_adds_gravity: bool  # the command is without the effort that carries the arm
    free_at: int  # ns from the first joint state at which freedrive is rehearsed, 0: never
    hold_at: int  # likewise, holding
    follow_at: int  # likewise, following again
    law_integers: Integers  # shape (LAW_INTEGERS,)
    blend: float  # s
    distance: float  # rad
    gravity: float  # 1: the safe effort compensates gravity, else 0
    stop_bandwidth: float  # rad/s
    fade: float  # s in which the effort fades while no joint state arrives; 0: no fading
    model: Model  # its parameters have shape (model parameters,)
    firmware: Model  # the model by which the robot's firmware adds gravity: that of the arm without a payload
    law: Array  # shape (joints, law parameters)
    estimator_parameters: Array  # shape (joints, SLOTS)
    effort_limit: Array  # shape (joints,), N m
    effort_rate: Array  # shape (joints,), N m/s
    min_position: Array  # shape (joints,), rad; no limit if it equals that of max_position
    max_position: Array  # likewise
    velocity_limit: Array  # shape (joints,), rad/s
    tracking_limit: Array  # shape (joints,), rad
    damping: Array  # of the safe effort, shape (joints,), N m s/rad
    plausible_velocity: Array  # shape (joints,), rad/s
    coulomb: Array  # friction that is compensated, shape (joints,), N m
    viscous: Array  # likewise, N m s/rad
    turn: Array  # 2 pi for a continuous joint, else 0, shape (joints,), rad
    external_limit: Array  # shape (joints,), N m
    free_velocity: Array  # shape (joints,), rad/s
    resistance: Array  # of the arm to a push in freedrive, shape (joints,), N m


class ControllerState(NamedTuple):
    """What a step changes; initially all zero."""

    clock: NDArray[np.int64]  # shape (len(Clock),)
    status: NDArray[np.int64]  # shape (len(Status),)
    history_stamps: NDArray[np.int64]  # of the rows of the history, shape (HISTORY,)
    measured: Array  # q as measured, written before a step, shape (joints,), rad
    applied: Array  # effort as the drives report it, if the configuration feeds_back, likewise, N m
    reference: Array  # q_d, q_d', q_d'' as received, written before a step, shape (3, joints)
    feedforward: Array  # effort of the reference as received, likewise, shape (joints,), N m
    given: Array  # values of a reference: `reference` and `feedforward`, shape (4, joints)
    held: Array  # desired motion while no reference is followed, likewise
    base: Array  # scratch: the reference at the sample, or the held position, likewise
    desired: Array  # the same plus the way: the motion that the law follows, likewise
    way: Array  # coefficients of the way, see desired.py, shape (6, joints)
    way_duration: Array  # shape (1,), s; 0: there is no way
    braking: Array  # coefficients of its first part, likewise
    braking_duration: Array  # shape (1,), s; 0: there is no such part
    hold_pace: Array  # shape (1,), s in which an effort fades at the begin of a stop, see safe.py
    hold_energy: Array  # shape (1,), J, the least kinetic energy since the controller has only damped the arm
    hold_bandwidth: Array  # shape (1,), rad/s, that of the configuration or as much as the rate of the samples allows
    estimator: Array  # shape (joints, SLOTS)
    law: Array  # shape (joints, STATE_SLOTS)
    inertia: Array  # of the model where the arm was stopped, shape (joints, joints), kg m^2
    signals: Array  # shape (len(Signal), joints), see `Signal`
    sent: Array  # the last command, shape (joints,), N m
    added: Array  # effort of the last tick beyond the law's: it compensates friction, or was fed forward, likewise
    turned: Array  # whole turns that are added to the reference of a continuous joint, shape (joints,), rad
    referred: Array  # position of the last reference that was followed, with these turns, shape (joints,), rad
    output: Array  # the command for the arm, shape (joints,), N m
    doubted: Array  # number of consecutive implausible measurements, shape (joints,)
    fed: Array  # effort of the reference that is added now, see desired.py, shape (joints,), N m
    fed_before: Array  # the same when the way began
    handed: Array  # what is added because it held the arm at the end of freedrive, likewise
    handed_before: Array  # the same when the way began
    hold: Array  # of the safe effort that holds the arm, see `Hold`, shape (len(Hold), joints)
    still: Array  # of joints whose measurements do not change, see `Still`, shape (len(Still), joints)
    history: Array  # positions as measured, a ring, see history.py, shape (HISTORY, joints), rad
    history_efforts: Array  # commanded before these measurements, likewise, N m
    handover: Array  # what is left of the difference that a change of the controller made, shape (joints,), N m
    external: Array  # effort that acts on the arm from outside, see `External`, shape (len(External), joints)
    rejected: Array  # disturbance that the law rejects, an acceleration, shape (joints,), rad/s^2
    truth: Array  # true q', q'' in a simulation, shape (2, joints), rad/s, rad/s^2
    torque: Array  # scratch of a simulation, shape (joints,), N m
    received: Array  # values of a joint state: `measured`, and `applied` if it is used, shape (1 or 2, joints)
    accelerations: Array  # scratch: a_eq, a_cmd, shape (2, joints)
    motion: Array  # scratch: the same and the estimated q'', shape (3, joints)
    scratch: Array  # shape (6, joints)
    net: Array  # scratch: effort that accelerates the arm, shape (joints,), N m


HISTORY = 16
"""Rows of the history of measured positions."""
_CONFIG_INTEGERS = 30  # lengths, and the integers of `ControllerConfig` except the law's
_FEEDS_BACK = 14
_CLOCK, _STATUS = len(Clock), len(Status)
_SCALARS = 10
# Rows of the table at the end of the floats, one number per joint: configuration, state, signals, scratch.
_EXTERNAL = 37
_HOLD = _EXTERNAL + len(External) + 1
_STILL = _HOLD + len(Hold)
_HISTORY = _STILL + len(Still)
_HISTORY_EFFORTS = _HISTORY + HISTORY
_HANDOVER = _HISTORY_EFFORTS + HISTORY
_CONFIG, _MOTION, _SCRATCH = 14, _HANDOVER + 1, 13
_ROWS = _CONFIG + _MOTION + len(Signal) + _SCRATCH


def floats_size(joints: int, model: int, law: int) -> int:
    """Length of the floats of `unpack`, for the numbers of parameters of the model and of the law (per joint)."""
    return _SCALARS + 2 * model + joints * (law + SLOTS + SLOTS + STATE_SLOTS + joints + _ROWS)


def integers_size() -> int:
    """Length of the integers of `unpack`."""
    return _CONFIG_INTEGERS + LAW_INTEGERS + _CLOCK + _STATUS + HISTORY


@inlined
def _config(floats: Array, rows: Array, integers: Integers) -> ControllerConfig:
    """The configuration in the arrays of `unpack`; `rows` is the table at their end, shape (_ROWS, joints)."""
    joints, model, law = integers[0], integers[1], integers[2]
    a = _SCALARS + 2 * model
    b = a + joints * law
    return ControllerConfig(
        estimator=integers[4],
        uses_model=integers[5] != 0,
        freezes=integers[6] != 0,
        stops=integers[7],
        state_hold=integers[8],
        state_stop=integers[9],
        reference_timeout=integers[10],
        reset_at=integers[11],
        restart_at=integers[12],
        rate_limited=integers[13] != 0,
        feeds_back=integers[_FEEDS_BACK] != 0,
        watches=integers[15] != 0,
        rehearses=integers[16] != 0,
        holds=integers[17] != 0,
        brakes=integers[18] != 0,
        compensates=integers[23] != 0,
        rejects=integers[22] != 0,
        doubts=integers[19] != 0,
        turns=integers[24] != 0,
        robot_adds_gravity=integers[25] != 0,
        feels=integers[26] != 0,
        free_at=integers[27],
        hold_at=integers[28],
        follow_at=integers[29],
        law_integers=integers[_CONFIG_INTEGERS : _CONFIG_INTEGERS + LAW_INTEGERS],
        blend=floats[0],
        distance=floats[1],
        gravity=floats[2],
        stop_bandwidth=floats[4],
        fade=floats[5],
        model=Model(integers[3], integers[20], integers[21], floats[_SCALARS : _SCALARS + model]),
        firmware=Model(integers[3], integers[20], integers[21], floats[_SCALARS + model : a]),
        law=floats[a:b].reshape((joints, law)),
        estimator_parameters=floats[b : b + joints * SLOTS].reshape((joints, SLOTS)),
        effort_limit=rows[0],
        effort_rate=rows[1],
        min_position=rows[2],
        max_position=rows[3],
        velocity_limit=rows[4],
        tracking_limit=rows[5],
        damping=rows[6],
        plausible_velocity=rows[7],
        coulomb=rows[8],
        viscous=rows[9],
        turn=rows[10],
        external_limit=rows[11],
        free_velocity=rows[12],
        resistance=rows[13],
    )


@inlined
def _state(floats: Array, rows: Array, integers: Integers) -> ControllerState:
    """The state in the arrays of `unpack`; `rows` as for `_config`."""
    joints = integers[0]
    c = _SCALARS + 2 * integers[1] + joints * (integers[2] + SLOTS)
    d = c + joints * SLOTS
    e = d + joints * STATE_SLOTS
    clock = _CONFIG_INTEGERS + LAW_INTEGERS
    status = clock + _CLOCK
    motion = rows[_CONFIG : _CONFIG + _MOTION]
    scratch = rows[_ROWS - _SCRATCH :]
    return ControllerState(
        clock=integers[clock:status],
        status=integers[status : status + _STATUS],
        history_stamps=integers[status + _STATUS :],
        measured=motion[0],
        applied=motion[1],
        reference=motion[2:5],
        feedforward=motion[5],
        given=motion[2:6],
        held=motion[6:9],
        base=motion[9:12],
        desired=motion[12:15],
        way=motion[15:21],
        way_duration=floats[3:4],
        braking=motion[31:37],
        braking_duration=floats[6:7],
        hold_pace=floats[7:8],
        hold_bandwidth=floats[8:9],
        hold_energy=floats[9:10],
        estimator=floats[c:d].reshape((joints, SLOTS)),
        law=floats[d:e].reshape((joints, STATE_SLOTS)),
        inertia=floats[e : e + joints * joints].reshape((joints, joints)),
        signals=rows[_CONFIG + _MOTION : _ROWS - _SCRATCH],
        sent=motion[21],
        added=motion[22],
        turned=motion[23],
        referred=motion[24],
        output=motion[25],
        doubted=motion[26],
        fed=motion[27],
        fed_before=motion[28],
        handed=motion[29],
        handed_before=motion[30],
        external=motion[_EXTERNAL : _HOLD - 1],
        rejected=motion[_HOLD - 1],
        hold=motion[_HOLD:_STILL],
        still=motion[_STILL:_HISTORY],
        history=motion[_HISTORY:_HISTORY_EFFORTS],
        history_efforts=motion[_HISTORY_EFFORTS:_HANDOVER],
        handover=motion[_HANDOVER],
        truth=scratch[:2],
        torque=scratch[2],
        received=motion[: 1 + integers[_FEEDS_BACK]],
        accelerations=scratch[3:5],
        motion=scratch[3:6],
        scratch=scratch[6:12],
        net=scratch[12],
    )


@inlined
def unpack(floats: Array, integers: Integers) -> tuple[ControllerConfig, ControllerState]:
    """A controller's configuration and state as views of its two arrays.

    A node calls compiled code a thousand times per second with cold processor caches, and each array argument then
    costs about a microsecond. Therefore two arrays contain the whole controller.

    Args:
        floats: shape (floats_size,): scalars, model, law, the estimator's parameters, the states of estimator and law,
            and a table of the values with one number per joint.
        integers: shape (integers_size,): joints, lengths of model and law, the integers of `ControllerConfig` in their
            order, clock, status.
    """
    joints = integers[0]
    rows = floats[floats.size - joints * _ROWS :].reshape((_ROWS, joints))
    return _config(floats, rows, integers), _state(floats, rows, integers)


def _example() -> tuple[ControllerConfig, ControllerState]:
    """Configuration and state of a controller with one joint."""
    integers = np.zeros(integers_size(), dtype=np.int64)
    integers[:3] = 1
    return unpack(np.zeros(floats_size(1, 1, 1)), integers)


part = PartOf(lambda: _example()[0], lambda: _example()[1])
"""Decorates a function of the controller that is compiled on its own, see `parts`: what few steps need."""
