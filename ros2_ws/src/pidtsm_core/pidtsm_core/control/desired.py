"""What the law is to follow: the reference or a held position, and the way there from where the arm is."""

import math

from pidtsm_core.compiled import njit, outlined
from pidtsm_core.control.state import Clock, ControllerConfig, ControllerState
from pidtsm_core.laws import command
from pidtsm_core.parameters import Array
from pidtsm_core.polynomials import add_quintic, quintic
from pidtsm_core.references import extrapolate
from pidtsm_core.robots import forward_dynamics, inverse_dynamics
from pidtsm_core.signals import Adaptation, Mode, Signal, Status
from pidtsm_core.timing import seconds

_SHARE_OF_RATE = 0.5
"""Of the limit of the rate that a way may use; the rest is for the law."""
_SHARE_OF_EFFORT = 0.9
_SHORTEST_WAY, _LONGEST_WAY, _LONGER = 0.01, 20.0, 1.2  # s, s, from one that is tried to the next
_SHORTEST_REST, _LONGEST_REST = 0.1, 2.0  # s in which the arm comes to rest
_MOMENTS = 12
_HOPELESS = 2.0
"""What is too much for a way, which allows only for a share of the rates."""
_ABSURD = 1e4  # rad/s^2; a correction beyond comes from a law that is singular


@njit
def choose(config: ControllerConfig, state: ControllerState, stamp: int, reference_stamp: int) -> None:
    """Choose between the reference and a held position, and write the desired motion at the sample.

    A reference is followed while it is no older than ``watchdog.reference``, nor further ahead. Once the controller
    holds, it takes one of half that age: references that are late by about the limit would switch to and fro.

    Args:
        config: what is read.
        state: what is changed.
        stamp: of the sample, ns.
        reference_stamp: of ``state.reference``, ns; negative where there is none.
    """
    clock, status, desired = state.clock, state.status, state.desired
    followed = clock[Clock.ANSWERED] > 0 and status[Status.MODE] == Mode.FOLLOWING
    stopped = status[Status.FAULT] != 0
    age = stamp - reference_stamp
    oldest = config.reference_timeout if followed else config.reference_timeout // 2
    follows = reference_stamp >= 0 and abs(age) <= oldest and not stopped
    status[Status.MODE] = Mode.STOPPED if stopped else (Mode.FOLLOWING if follows else Mode.HOLDING)
    clock[Clock.REFERENCE_AGE] = age if reference_stamp >= 0 else 0
    if follows and not followed:
        # From the motion desired last; at the very first sample that is rest where the arm is.
        _begin_way(config, state, desired, stamp)
        clock[Clock.ADAPTATION] = Adaptation.APPROACHING if state.way_duration[0] > 0.0 else Adaptation.NORMAL
        clock[Clock.STRAYED] = 0
    elif followed and not follows:
        come_to_rest(config, state, stamp)
    write_desired(state, stamp)


@njit
def write_desired(state: ControllerState, stamp: int) -> None:
    """Write what is followed or held, with the way there, at `stamp` (ns) to ``state.desired``."""
    write_base(state, state.desired)
    duration = state.way_duration[0]
    if duration > 0.0:
        t = seconds(stamp - state.clock[Clock.WAY_BEGAN])
        if t < duration:
            add_quintic(state.way, duration, t, state.desired)
        else:
            _end_way(state)


@outlined
def begin_at(state: ControllerState, position: Array) -> None:
    """Desire rest at `position`, shape (joints,), rad."""
    _end_way(state)
    for j in range(position.size):
        state.held[0, j] = position[j]
        state.held[1, j] = 0.0
        state.held[2, j] = 0.0
        for i in range(3):
            state.desired[i, j] = state.held[i, j]


@outlined
def come_to_rest(config: ControllerConfig, state: ControllerState, stamp: int) -> None:
    """Desire to come to rest, without a step of position, velocity or acceleration, from the motion desired now.

    Where that ends is where a quartic does, which has neither to turn back nor to hurry.
    """
    _end_way(state)
    start, duration = state.scratch[3:], _SHORTEST_REST
    for i in range(3):
        for j in range(start.shape[1]):
            start[i, j] = state.desired[i, j]
    _plan_rest(state, start, duration)
    while duration < _LONGEST_REST and _excess(config, state, duration) > 1.0:
        duration *= _LONGER
        _plan_rest(state, start, duration)
    state.way_duration[0] = duration
    state.clock[Clock.WAY_BEGAN] = stamp
    for i in range(3):
        for j in range(start.shape[1]):
            state.desired[i, j] = start[i, j]


@njit
def _plan_rest(state: ControllerState, start: Array, duration: float) -> None:
    """Write the position in which a stop from `start` (q, q', q'', shape (3, joints)) in so long ends, and the way."""
    for j in range(start.shape[1]):
        state.held[0, j] = start[0, j] + duration * (0.5 * start[1, j] + duration * start[2, j] / 12.0)
        for i in range(1, 3):
            state.held[i, j] = 0.0
        for i in range(3):
            state.base[i, j] = state.held[i, j]
    quintic(start, state.held, duration, state.way)
    # The way is the difference to what is held.
    for j in range(start.shape[1]):
        state.way[0, j] -= state.held[0, j]


@njit
def write_base(state: ControllerState, motion: Array) -> None:
    """Write the reference at the sample, or what is held instead, to `motion`, shape (3, joints)."""
    follows, age = state.status[Status.MODE] == Mode.FOLLOWING, state.clock[Clock.REFERENCE_AGE]
    if follows and age:
        extrapolate(state.reference, seconds(age), motion)
        return
    source = state.reference if follows else state.held
    for i in range(3):
        for j in range(motion.shape[1]):
            motion[i, j] = source[i, j]


@njit
def _end_way(state: ControllerState) -> None:
    state.way_duration[0] = 0.0
    state.clock[Clock.ADAPTATION] = Adaptation.NORMAL
    state.clock[Clock.STRAYED] = 0


@outlined
def _begin_way(config: ControllerConfig, state: ControllerState, start: Array, stamp: int) -> float:
    """Plan the way from `start` (q, q', q'', shape (3, joints)) to what is followed or held: their difference dies out.

    Returns:
        What `_excess` says of the way; 0 where no rate is limited.
    """
    difference, rest = state.scratch[:3], state.scratch[3:]
    write_base(state, state.base)
    for i in range(3):
        for j in range(start.shape[1]):
            difference[i, j] = start[i, j] - state.base[i, j]
            rest[i, j] = 0.0
    duration, excess = config.blend, 0.0
    if config.rate_limited:
        duration, excess = _duration(config, state, difference, rest)
    if duration > 0.0:
        quintic(difference, rest, duration, state.way)
    state.way_duration[0] = duration
    state.clock[Clock.WAY_BEGAN] = stamp
    return excess


@njit
def _duration(config: ControllerConfig, state: ControllerState, difference: Array, rest: Array) -> tuple[float, float]:
    """How long a way must take, s, for an `_excess` of at most 1, or else for the least; and that excess."""
    duration = best = max(config.blend, _SHORTEST_WAY)
    least = math.inf
    while duration < _LONGEST_WAY:
        quintic(difference, rest, duration, state.way)
        excess = _excess(config, state, duration)
        if excess < least:
            best, least = duration, excess
        if excess <= 1.0:
            break
        duration *= _LONGER
    return best, least


@njit
def _excess(config: ControllerConfig, state: ControllerState, duration: float) -> float:
    """The largest effort, or change of it, along ``state.way`` by the model, as a multiple of what it may be.

    Judged at some moments, as if the base moved on with its velocity.
    """
    motion, efforts = state.desired, state.accelerations
    step, excess = duration / _MOMENTS, 0.0
    for k in range(_MOMENTS + 1):
        t = k * step
        for j in range(motion.shape[1]):
            motion[0, j] = state.base[0, j] + t * state.base[1, j]
            motion[1, j] = state.base[1, j]
            motion[2, j] = 0.0
            efforts[1, j] = efforts[0, j]
        add_quintic(state.way, duration, t, motion)
        inverse_dynamics(config.robot, motion[0], motion[1], motion[2:], config.model, efforts[:1])
        for j in range(motion.shape[1]):
            excess = max(excess, abs(efforts[0, j]) / (_SHARE_OF_EFFORT * config.effort_limit[j]) if k else 0.0)
            if k and config.effort_rate[j] > 0.0:
                rate = abs(efforts[0, j] - efforts[1, j]) / step
                excess = max(excess, rate / (_SHARE_OF_RATE * config.effort_rate[j]))
    return excess


@outlined
def begin_way_here(config: ControllerConfig, state: ControllerState, stamp: int) -> bool:
    """Begin a way at the arm's estimated motion, with the acceleration for which the law asks for the effort applied.

    That is the acceleration that the effort gives by the model, less what the law would add without any error, which
    is what it has learnt of the disturbances. So neither the desired motion nor the effort makes a step.

    Returns:
        Whether the limits, nearly, let the arm go that way.
    """
    y, start = state.signals, state.desired
    forward_dynamics(config.robot, y[Signal.POSITION], y[Signal.VELOCITY], y[Signal.EFFORT], config.model, start[2])
    for j in range(state.measured.size):
        start[0, j] = y[Signal.POSITION, j]
        start[1, j] = y[Signal.VELOCITY, j]
        learnt = command(0.0, 0.0, 0.0, 0.0, config.law_integers, config.law[j], state.law[j], 0.0)[0]
        if abs(learnt) < _ABSURD:
            start[2, j] -= learnt
    excess = _begin_way(config, state, start, stamp)
    write_base(state, state.desired)
    add_quintic(state.way, state.way_duration[0], 0.0, state.desired)
    if state.clock[Clock.ADAPTATION] == Adaptation.NORMAL:
        state.clock[Clock.STRAYED] = 1
    state.clock[Clock.ADAPTATION] = Adaptation.FROZEN
    return excess < _HOPELESS
