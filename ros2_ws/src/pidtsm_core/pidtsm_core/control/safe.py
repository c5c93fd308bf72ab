"""The safe effort of a controller that has stopped: it holds or damps the arm, depending on ``stop.effort``."""

import math

from pidtsm_core.compiled import inlined
from pidtsm_core.control.desired import come_to_rest, learnt_acceleration, write_desired
from pidtsm_core.control.effort import added_gravity, carry, limit_effort
from pidtsm_core.control.state import Clock, ControllerConfig, ControllerState, Hold, part
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.signals import Signal
from pidtsm_core.timing import seconds

_CUTOFF = 10.0
"""Cutoff of the velocity filter, as a multiple of the bandwidth of the position control."""
_QUICKEST = 0.125
"""s; time in which a difference as large as the effort limit fades, so that a stop causes no jolt."""
_LARGEST_CHANGE = 0.08
"""Largest change from one command to the next, as a share of the effort limit."""
_LONGEST_CHANGE = 0.01
"""s; longest time between two commands that counts for this."""
_LARGEST_SHARE = 0.5
"""Largest share of the effort limit that is accepted as learnt by the law."""
_AT_REST = 0.02  # rad/s
_HOLDS, ELSEWHERE = 1, 2
"""Values of `Clock.HELD`; ELSEWHERE: the arm may have moved since, and will be held at its new position."""


@part
def make_safe(config: ControllerConfig, state: ControllerState, stamp: int, dt: float) -> None:
    """Replace the effort for the joint state of `stamp` (ns), dt (s) after the last one, with the safe effort."""
    _add_nothing(state)
    if config.holds:
        _hold(config, state, stamp, dt)
    else:
        _damp(config, state)
    if config.brakes:
        _engage_brakes(config, state)


@part
def make_safe_blindly(config: ControllerConfig, state: ControllerState, now: int) -> None:
    """Replace the effort with the safe one while no joint state arrives, at `now` (ns, in the time of the stamps).

    The effort follows from the model and from what was learnt: it stops the arm from its last known motion, then holds
    it. Meanwhile it fades.
    """
    clock = state.clock
    _add_nothing(state)
    clock[Clock.BRAKES] = config.brakes
    if not config.holds:
        _damp(config, state)
        return
    begins = clock[Clock.SILENT_SINCE] == 0
    if begins:
        clock[Clock.SILENT_SINCE] = now + 1
        if clock[Clock.HELD] == 0:
            _begin(config, state, clock[Clock.LAST])
    write_desired(state, now)
    gone = seconds(now + 1 - clock[Clock.SILENT_SINCE])
    left = max(0.0, 1.0 - gone / config.fade) if config.fade > 0.0 else 1.0
    _follow_blindly(config, state)
    _fade(config, state, left)
    limit_effort(config, state)
    go_gently(config, state, now, begins)
    clock[Clock.HELD] = ELSEWHERE


@inlined
def _add_nothing(state: ControllerState) -> None:
    """The safe effort compensates no friction, and feeds nothing forward; the estimator must know."""
    for j in range(state.added.size):
        state.added[j] = 0.0


@inlined
def _fade(config: ControllerConfig, state: ControllerState, left: float) -> None:
    """Leave a share of the effort; what the arm's firmware adds remains, so that the command fades to zero."""
    efforts, added = state.signals[Signal.EFFORT], state.scratch[0]
    if config.robot_adds_gravity:
        added_gravity(config, state)
        for j in range(efforts.size):
            efforts[j] = added[j] + left * (efforts[j] - added[j])
    else:
        for j in range(efforts.size):
            efforts[j] *= left


@part
def leave(config: ControllerConfig, state: ControllerState) -> None:
    """Replace the effort with the one that remains applied after the controller ends: it holds or damps the arm."""
    if not config.holds:
        _damp(config, state)
        return
    if state.clock[Clock.HELD] == 0:
        learn(config, state)
    for j in range(state.measured.size):
        state.desired[0, j] = state.signals[Signal.POSITION, j]
        state.desired[1, j] = 0.0
        state.desired[2, j] = 0.0
    _follow_blindly(config, state)
    limit_effort(config, state)


@inlined
def _damp(config: ControllerConfig, state: ControllerState) -> None:
    """Compute gravity compensation, if configured, minus damping; the arm's firmware adds gravity in any case."""
    y, added = state.signals, state.scratch[0]
    carry(config, state, y[Signal.POSITION])
    for j in range(y.shape[1]):
        y[Signal.EFFORT, j] *= config.gravity
    if config.robot_adds_gravity and config.gravity == 0.0:
        added_gravity(config, state)
        for j in range(y.shape[1]):
            y[Signal.EFFORT, j] = added[j]
    for j in range(y.shape[1]):
        y[Signal.EFFORT, j] -= config.damping[j] * y[Signal.VELOCITY, j]
    limit_effort(config, state)


@inlined
def learn(config: ControllerConfig, state: ControllerState) -> None:
    """Store what the law has learnt: the effort that it adds to that of the model without any error."""
    y, scratch = state.signals, state.scratch
    for j in range(scratch.shape[1]):
        learnt = learnt_acceleration(config, state, j)
        state.accelerations[0, j] = 0.0
        state.accelerations[1, j] = learnt
        scratch[0, j] = 0.0
        # The output of a law without model is an effort.
        state.hold[Hold.LEARNT, j] = learnt
        state.hold[Hold.INTEGRAL, j] = 0.0
    inverse_dynamics(config.model, y[Signal.POSITION], scratch[0], state.accelerations, scratch[1:3])
    for j in range(scratch.shape[1]):
        effort = scratch[2, j] if config.uses_model else state.hold[Hold.LEARNT, j]
        learnt, most = effort - scratch[1, j], _LARGEST_SHARE * config.effort_limit[j]
        state.hold[Hold.LEARNT, j] = min(max(learnt, -most), most) if math.isfinite(learnt) else 0.0


@inlined
def _begin(config: ControllerConfig, state: ControllerState, stamp: int) -> None:
    """Start a desired motion from the present motion of the arm to rest."""
    y = state.signals
    if state.clock[Clock.HELD] == 0:
        learn(config, state)
    for j in range(state.measured.size):
        velocity, most = y[Signal.VELOCITY, j], config.plausible_velocity[j]
        if most > 0.0:
            velocity = min(max(velocity, -most), most)
        state.hold[Hold.VELOCITY, j] = velocity
        state.hold[Hold.POSITION, j] = state.measured[j]
        state.desired[0, j] = state.measured[j]
        state.desired[1, j] = velocity
        state.desired[2, j] = 0.0
    come_to_rest(config, state, stamp)
    state.clock[Clock.HELD] = _HOLDS


@inlined
def _hold(config: ControllerConfig, state: ControllerState, stamp: int, dt: float) -> None:
    """Control the position on the way to rest and at rest, with an integral and all poles at the bandwidth."""
    y, hold, clock, w = state.signals, state.hold, state.clock, config.hold_bandwidth
    begins = clock[Clock.HELD] != _HOLDS
    if begins:
        _begin(config, state, stamp)
        dt = 0.0
    passed = -math.expm1(-_CUTOFF * w * dt)
    for j in range(y.shape[1]):
        q = state.measured[j]
        if dt > 0.0:
            hold[Hold.VELOCITY, j] += passed * ((q - hold[Hold.POSITION, j]) / dt - hold[Hold.VELOCITY, j])
        hold[Hold.POSITION, j] = q
        e, de = q - state.desired[0, j], hold[Hold.VELOCITY, j] - state.desired[1, j]
        state.accelerations[0, j] = state.desired[2, j]
        state.accelerations[1, j] = state.desired[2, j] - w * (3.0 * de + w * (3.0 * e + w * hold[Hold.INTEGRAL, j]))
    efforts = y[Signal.EQUIVALENT_EFFORT : Signal.EFFORT + 1]
    inverse_dynamics(config.model, hold[Hold.POSITION], hold[Hold.VELOCITY], state.accelerations, efforts)
    for j in range(y.shape[1]):
        y[Signal.EFFORT, j] += hold[Hold.LEARNT, j]
    limit_effort(config, state)
    go_gently(config, state, stamp, begins)
    for j in range(y.shape[1]):
        if y[Signal.SATURATED, j] == 0.0 and clock[Clock.BRAKES] == 0:
            hold[Hold.INTEGRAL, j] += dt * (state.measured[j] - state.desired[0, j])


@inlined
def go_gently(config: ControllerConfig, state: ControllerState, now: int, begins: bool) -> None:
    """Fade from the last command to the safe effort, so that the stop causes no jolt; `now` is in ns.

    Where the safe effort `begins`, the difference is added to it, and fades. A limit of its rate instead would delay
    the position control, which then swings the arm if the stop needs much effort.
    """
    efforts, offset = state.signals[Signal.EFFORT], state.hold[Hold.OFFSET]
    since = min(max(seconds(now - state.clock[Clock.SENT]), 0.0), _LONGEST_CHANGE)
    for j in range(efforts.size):
        if begins:
            offset[j] = state.sent[j] - efforts[j]
        change = config.effort_limit[j] * since / _QUICKEST
        offset[j] -= min(max(offset[j], -change), change)
        limit, last = config.effort_limit[j], state.sent[j]
        low, high = max(last - _LARGEST_CHANGE * limit, -limit), min(last + _LARGEST_CHANGE * limit, limit)
        efforts[j] = min(max(efforts[j] + offset[j], low), high)


@inlined
def _follow_blindly(config: ControllerConfig, state: ControllerState) -> None:
    """Compute the effort of the desired motion from the model and from what was learnt beyond it."""
    w, efforts = config.hold_bandwidth, state.signals[Signal.EQUIVALENT_EFFORT : Signal.EFFORT + 1]
    for j in range(state.measured.size):
        state.accelerations[0, j] = state.desired[2, j]
        state.accelerations[1, j] = state.desired[2, j] - w * w * w * state.hold[Hold.INTEGRAL, j]
    inverse_dynamics(config.model, state.desired[0], state.desired[1], state.accelerations, efforts)
    for j in range(state.measured.size):
        efforts[1, j] += state.hold[Hold.LEARNT, j]


@inlined
def _engage_brakes(config: ControllerConfig, state: ControllerState) -> None:
    """Engage the brakes once the arm has come to rest; they stay engaged until the fault is reset."""
    still = state.way_duration[0] == 0.0
    velocity = state.hold[Hold.VELOCITY] if config.holds else state.signals[Signal.VELOCITY]
    for j in range(velocity.size):
        still = still and abs(velocity[j]) < _AT_REST
    if still:
        state.clock[Clock.BRAKES] = 1
