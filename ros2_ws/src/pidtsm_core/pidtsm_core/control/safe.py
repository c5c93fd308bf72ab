"""The safe effort of a controller that has stopped: it holds or damps the arm, depending on ``stop.effort``.

Holding is a spring, a damper and an integral that tie the arm to a motion that comes to rest. Stiffness and damping are
the inertia of the model where the arm was stopped, times constants. They are symmetric and positive, so the energy of
arm and spring can only decay, whatever the true inertia is (docs/stops.md has the argument). Where the arm does not
obey, supervision.py gives up holding.
"""

import math

from pidtsm_core.compiled import inlined
from pidtsm_core.control.contact import in_contact
from pidtsm_core.control.desired import come_to_rest, learnt_acceleration, write_desired
from pidtsm_core.control.effort import LARGEST_CHANGE, added_gravity, carry, limit_effort, time_of_change
from pidtsm_core.control.history import HISTORY, RECENT, noted_acceleration, noted_effort, noted_motion
from pidtsm_core.control.state import Clock, ControllerConfig, ControllerState, External, Held, Hold, Still, part
from pidtsm_core.control.supervision import damp_inertia, gives_up, supervise
from pidtsm_core.control.trust import is_doubtful, reverse, used_position
from pidtsm_core.robots import forward_dynamics, inverse_dynamics
from pidtsm_core.signals import Fault, Signal, Status, Stop
from pidtsm_core.timing import seconds

_CUTOFF = 10.0
"""Cutoff of the velocity filter, as a multiple of the bandwidth of the position control."""
_QUICKEST, _SLOWEST = 0.02, 0.125
"""s; time in which a difference as large as the effort limit fades, so that a stop causes no jolt."""
_FADES_OVER = 0.015
"""rad; way of the arm in this time: an arm that moves fast needs the safe effort sooner."""
_LONGEST_CHANGE = 0.01
"""s; longest time between two commands that counts for this."""
_LARGEST_SHARE = 0.5
"""Largest share of the effort limit that is accepted as learnt by the law."""
_AT_REST = 0.02  # rad/s
_LONG_CHANGE = 0.04
"""s; an effort that needs longer to change by its limit cannot follow a way that begins without acceleration."""
_OF_CHANGE = 1.0
"""Largest bandwidth of the hold relative to the inverse of the time in which its effort can change by its limit, which
grows with the time between commands."""
_SHARE_OF_LIMIT, _AWAY = 0.5, 0.05
"""Largest share of the effort limit that the spring of the hold needs for a distance of the joint, rad: a hold whose
effort is at its limits swings."""
_WAY_TO_REST, _SHORTEST_REST, _LONGEST_REST = 0.03, 0.02, 0.1
"""rad; way to rest that is short enough for the most gentle stop; s, s; times to rest that are tried first."""
_DETOUR = 0.02
"""rad; if a rate limit makes the way to rest longer by more, it is suspended."""
_SHARE_OF_RATE = 0.5
"""Share of a rate limit in which the difference fades."""
_LARGEST_VELOCITY = 1.5
"""Largest velocity at which a stop may begin, as a multiple of the velocity limit: more is a wrong measurement."""


@part
def make_safe(config: ControllerConfig, state: ControllerState, stamp: int, dt: float) -> None:
    """Replace the effort for the joint state of `stamp` (ns), dt (s) after the last one, with the safe effort."""
    _add_nothing(state)
    if config.holds:
        _hold(config, state, stamp, dt)
        supervise(config, state, stamp)
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
        if clock[Clock.HELD] == Held.NOT:
            begin_hold(config, state, clock[Clock.LAST])
    write_desired(state, now)
    gone = seconds(now + 1 - clock[Clock.SILENT_SINCE])
    left = max(0.0, 1.0 - gone / config.fade) if config.fade > 0.0 else 1.0
    _follow_blindly(config, state)
    _fade(config, state, left)
    limit_effort(config, state)
    go_gently(config, state, now, begins)
    clock[Clock.HELD] = Held.ELSEWHERE
    state.status[Status.STOP_STAGE] = Stop.BLIND


@inlined
def _add_nothing(state: ControllerState) -> None:
    """The safe effort compensates no friction, and feeds nothing forward; the estimator must know."""
    for j in range(state.added.size):
        state.added[j] = 0.0


@inlined
def _fade_distrusted(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Fade the effort of joints that are not trusted; what the arm's firmware adds remains."""
    efforts, blind = state.signals[Signal.EFFORT], False
    for j in range(efforts.size):
        blind = blind or state.hold[Hold.DISTRUSTED, j] != 0.0
    if not blind or config.fade <= 0.0:
        return
    added = state.scratch[0]
    if config.robot_adds_gravity:
        added_gravity(config, state)
    for j in range(efforts.size):
        if state.hold[Hold.DISTRUSTED, j] != 0.0:
            state.hold[Hold.BLIND, j] += dt
            least = added[j] if config.robot_adds_gravity else 0.0
            efforts[j] = least + max(0.0, 1.0 - state.hold[Hold.BLIND, j] / config.fade) * (efforts[j] - least)


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
    if state.clock[Clock.HELD] == Held.NOT:
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


@part
def begin_hold(config: ControllerConfig, state: ControllerState, stamp: int) -> None:
    """Start a desired motion from the present motion of the arm to rest, and weigh the arm."""
    clock = state.clock
    if clock[Clock.HELD] == Held.NOT:
        learn(config, state)
        _doubt_what_was_learnt(config, state, stamp)
    fastest = 0.0
    for j in range(state.measured.size):
        position, velocity = _present_motion(config, state, stamp, j)
        fastest = max(fastest, abs(velocity))
        if clock[Clock.HELD] == Held.NOT:
            state.hold[Hold.BEFORE, j] = velocity
        state.hold[Hold.VELOCITY, j] = velocity
        state.hold[Hold.POSITION, j] = position
        state.desired[0, j] = position
        state.desired[1, j] = velocity
        state.desired[2, j] = 0.0
    if time_of_change(state) > _LONG_CHANGE:
        _continue_acceleration(config, state)
    state.hold_pace[0] = min(max(_FADES_OVER / max(fastest, 1e-9), _QUICKEST), _SLOWEST)
    _plan_stop(config, state, stamp, fastest)
    _weigh(config, state)
    _choose_bandwidth(config, state)
    state.clock[Clock.HELD] = Held.HERE
    state.status[Status.STOP_STAGE] = Stop.HOLD


@inlined
def _continue_acceleration(config: ControllerConfig, state: ControllerState) -> None:
    """Begin the way to rest with the acceleration that the last command causes, because it cannot change at once."""
    for j in range(state.sent.size):
        state.net[j] = state.sent[j] - state.hold[Hold.LEARNT, j]
        state.scratch[0, j] = state.desired[0, j]
        state.scratch[1, j] = state.desired[1, j]
    forward_dynamics(config.model, state.scratch[0], state.scratch[1], state.net, state.desired[2])


@inlined
def _choose_bandwidth(config: ControllerConfig, state: ControllerState) -> None:
    """Choose the bandwidth of the hold: that of the configuration, or what rate and torque limits of the arm allow."""
    bandwidth, slowest = config.stop_bandwidth, time_of_change(state)
    if slowest > 0.0:
        bandwidth = min(bandwidth, _OF_CHANGE / slowest)
    for j in range(state.measured.size):
        stiffness = _SHARE_OF_LIMIT * config.effort_limit[j] / _AWAY
        if state.inertia[j, j] > 0.0:
            bandwidth = min(bandwidth, math.sqrt(stiffness / (3.0 * state.inertia[j, j])))
    state.hold_bandwidth[0] = bandwidth


@part
def _plan_stop(config: ControllerConfig, state: ControllerState, stamp: int, fastest: float) -> None:
    """Plan the way to rest for an arm of which the fastest joint has this speed (rad/s).

    It keeps the rate limit if the arm then goes only little farther; otherwise the limit is suspended.
    """
    clock, shortest = state.clock, min(max(2.0 * _WAY_TO_REST / max(fastest, 1e-9), _SHORTEST_REST), _LONGEST_REST)
    suspended = clock[Clock.UNLIMITED]
    clock[Clock.UNLIMITED] = 1
    come_to_rest(config, state, stamp, shortest)
    if config.rate_limited and suspended == 0:
        unlimited = state.way_duration[0]
        clock[Clock.UNLIMITED] = 0
        come_to_rest(config, state, stamp, shortest)
        if 0.5 * fastest * (state.way_duration[0] - unlimited) > _DETOUR:
            clock[Clock.UNLIMITED] = 1
            come_to_rest(config, state, stamp, shortest)


@part
def keep_what_holds(config: ControllerConfig, state: ControllerState) -> None:
    """Let the law start with what holds the arm: with what it has learnt if that is nearer to it than nothing.

    Its state is part of some faults, such as an error that has wound up an integral.
    """
    w, scratch, held = state.hold_bandwidth[0], state.scratch, state.scratch[5]
    for j in range(held.size):
        held[j] = state.hold[Hold.LEARNT, j]
        for k in range(held.size):
            held[j] -= w * w * w * state.inertia[j, k] * state.hold[Hold.INTEGRAL, k]
    learn(config, state)
    for j in range(held.size):
        learnt = state.hold[Hold.LEARNT, j]
        absurd = abs(learnt) >= _LARGEST_SHARE * config.effort_limit[j]
        if absurd or abs(scratch[5, j] - learnt) > abs(scratch[5, j]):
            for slot in range(state.law.shape[1]):
                state.law[j, slot] = 0.0


@inlined
def _middle(a: float, b: float, c: float) -> float:
    """The median of three numbers: one of them may be arbitrarily wrong."""
    return max(min(a, b), min(max(a, b), c))


@part
def _present_motion(
    config: ControllerConfig, state: ControllerState, stamp: int, joint: int
) -> tuple[float, float]:
    """Position (rad) and velocity (rad/s) of a joint at `stamp` (ns), of which no single measurement decides.

    The velocity is the median of the estimated one, of that of the last measurements, and of that of more of them. If
    the joint is not trusted, its estimates are not, either; once it is held, what the hold uses counts.
    """
    y, hold = state.signals, state.hold
    if is_doubtful(state, joint) and state.clock[Clock.HELD] != Held.NOT:
        return hold[Hold.POSITION, joint], hold[Hold.VELOCITY, joint]
    recent, velocity = noted_motion(state, stamp, joint, RECENT)
    _, before = noted_motion(state, stamp, joint, HISTORY)
    if is_doubtful(state, joint):
        velocity = before
    else:
        recent = _middle(state.measured[joint], recent, y[Signal.POSITION, joint])
        velocity = _middle(y[Signal.VELOCITY, joint], velocity, before)
    most = config.plausible_velocity[joint] if config.plausible_velocity[joint] > 0.0 else math.inf
    if config.velocity_limit[joint] > 0.0:
        most = min(most, _LARGEST_VELOCITY * config.velocity_limit[joint])
    return recent, min(max(velocity, -most), most)


@inlined
def _doubt_what_was_learnt(config: ControllerConfig, state: ControllerState, stamp: int) -> None:
    """Of what the law has learnt, believe what the motion of the arm confirms: its output may be part of the fault.

    The median of it, of the effort that acts on the arm from outside (see contact.py), and of what the noted efforts
    were beyond those that the noted motion needs. In contact, which is no load to carry, what acted from outside when
    the arm was last near its reference takes the place of the latter. If efforts have had no effect, those count that
    were applied before.
    """
    if state.status[Status.FAULT] == Fault.NO_EFFECT:
        carry(config, state, state.measured)
        for j in range(state.measured.size):
            if state.hold[Hold.DISTRUSTED, j] != 0.0:
                state.hold[Hold.LEARNT, j] = state.still[Still.EFFORT, j] - state.signals[Signal.EFFORT, j]
        return
    external, learnt = state.external, state.hold[Hold.LEARNT]
    _find_load(config, state, stamp)
    touches = state.status[Status.FAULT] == Fault.EXTERNAL_EFFORT_LIMIT or in_contact(config, state)
    enough = state.clock[Clock.NOTES] >= RECENT
    for j in range(state.measured.size):
        noted = state.scratch[2, j] if enough else 0.0
        if not config.feels:
            learnt[j] = _middle(learnt[j], noted, 0.0)
        elif touches:
            learnt[j] = _middle(learnt[j], -external[External.TWICE, j], -external[External.USUAL, j])
        else:
            learnt[j] = _middle(learnt[j], -external[External.TWICE, j], noted)


@part
def _find_load(config: ControllerConfig, state: ControllerState, stamp: int) -> None:
    """Write what was applied beyond what the noted motion needs, by the model, to ``state.scratch[2]``, N m."""
    motion, velocities = state.motion, state.scratch[0]
    for j in range(state.measured.size):
        _, velocities[j] = noted_motion(state, stamp, j, RECENT)
        motion[0, j] = noted_acceleration(state, stamp, j)
    inverse_dynamics(config.model, state.measured, velocities, motion[:1], state.scratch[2:3])
    for j in range(state.measured.size):
        state.scratch[2, j] = noted_effort(state, stamp, j) - state.scratch[2, j]


@part
def _weigh(config: ControllerConfig, state: ControllerState) -> None:
    """Write the inertia of the model where the arm is to ``state.inertia``."""
    joints = state.measured.size
    still, efforts = state.accelerations, state.scratch[1:3]
    for k in range(joints):
        for j in range(joints):
            still[0, j] = still[1, j] = state.scratch[0, j] = 0.0
        still[1, k] = 1.0
        inverse_dynamics(config.model, state.hold[Hold.POSITION], state.scratch[0], still, efforts)
        for j in range(joints):
            state.inertia[j, k] = efforts[1, j] - efforts[0, j]


@inlined
def _hold(config: ControllerConfig, state: ControllerState, stamp: int, dt: float) -> None:
    """Tie the arm to its way to rest by spring, damper and integral, all poles at the bandwidth."""
    y, hold = state.signals, state.hold
    begins = state.clock[Clock.HELD] != Held.HERE
    if begins:
        begin_hold(config, state, stamp)
        dt = 0.0
    w = state.hold_bandwidth[0]
    _filter_motion(config, state, dt)
    if gives_up(state):
        damp_inertia(config, state)
    else:
        efforts = y[Signal.EQUIVALENT_EFFORT : Signal.EQUIVALENT_EFFORT + 1]
        inverse_dynamics(config.model, hold[Hold.POSITION], state.desired[1], state.desired[2:], efforts)
        pull = state.accelerations[1]
        for j in range(pull.size):
            e, de = hold[Hold.POSITION, j] - state.desired[0, j], hold[Hold.VELOCITY, j] - state.desired[1, j]
            pull[j] = -w * (3.0 * de + w * (3.0 * e + w * hold[Hold.INTEGRAL, j]))
        for j in range(pull.size):
            effort = y[Signal.EQUIVALENT_EFFORT, j] + hold[Hold.LEARNT, j]
            for k in range(pull.size):
                effort += state.inertia[j, k] * pull[k]
            y[Signal.EFFORT, j] = effort
    _fade_distrusted(config, state, dt)
    limit_effort(config, state)
    go_gently(config, state, stamp, begins)
    _integrate(state, dt)


@inlined
def _filter_motion(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Update measured position and filtered velocity; a joint that is not trusted is taken to move as desired."""
    hold, passed = state.hold, -math.expm1(-_CUTOFF * state.hold_bandwidth[0] * dt)
    for j in range(state.measured.size):
        q = used_position(config, state, j, dt)
        blind = hold[Hold.DISTRUSTED, j] != 0.0
        if blind:
            hold[Hold.VELOCITY, j] = state.desired[1, j]
        elif dt > 0.0:
            hold[Hold.VELOCITY, j] += passed * ((q - hold[Hold.POSITION, j]) / dt - hold[Hold.VELOCITY, j])
        if blind or dt > 0.0:
            hold[Hold.POSITION, j] = q
    reverse(config, state, dt)


@inlined
def _integrate(state: ControllerState, dt: float) -> None:
    """Let the integral of the error grow while the effort can follow it."""
    if state.clock[Clock.BRAKES] == 0 and state.clock[Clock.SLEWING] == 0 and not gives_up(state):
        for j in range(state.measured.size):
            if state.signals[Signal.SATURATED, j] == 0.0:
                error = state.hold[Hold.POSITION, j] - state.desired[0, j]
                state.hold[Hold.INTEGRAL, j] += dt * error


@inlined
def go_gently(config: ControllerConfig, state: ControllerState, now: int, begins: bool) -> None:
    """Fade from the last command to the safe effort, so that the stop causes no jolt; `now` is in ns.

    Where the safe effort `begins`, the difference is added to it, and fades. A limit of its rate instead would delay
    the position control, which then swings the arm if the stop needs much effort.
    """
    efforts, offset = state.signals[Signal.EFFORT], state.hold[Hold.OFFSET]
    state.clock[Clock.SLEWING] = 0
    if begins:
        for j in range(efforts.size):
            offset[j] = state.sent[j] - efforts[j]
        _judge_rate_limit(config, state)
    since = min(max(seconds(now - state.clock[Clock.SENT]), 0.0), _LONGEST_CHANGE)
    for j in range(efforts.size):
        change = _fading_rate(config, state, j) * since
        offset[j] -= min(max(offset[j], -change), change)
        limit, last = config.effort_limit[j], state.sent[j]
        low, high = max(last - LARGEST_CHANGE * limit, -limit), min(last + LARGEST_CHANGE * limit, limit)
        wanted = efforts[j] + offset[j]
        efforts[j] = min(max(wanted, low), high)
        state.clock[Clock.SLEWING] |= int(efforts[j] != wanted)


@inlined
def _fading_rate(config: ControllerConfig, state: ControllerState, joint: int) -> float:
    """Rate at which the difference of a joint fades, N m/s."""
    rate = config.effort_limit[joint] / (state.hold_pace[0] if state.hold_pace[0] > 0.0 else _SLOWEST)
    limited = state.status[Status.FAULT] != 0 and config.effort_rate[joint] > 0.0 and state.clock[Clock.UNLIMITED] == 0
    return min(rate, _SHARE_OF_RATE * config.effort_rate[joint]) if limited else rate


@inlined
def _judge_rate_limit(config: ControllerConfig, state: ControllerState) -> None:
    """Suspend the rate limit if the arm went too far astray while the difference fades within it.

    Without the hold, a difference d that fades at the rate r displaces an inertia m by d^3 / (6 m r^2); with it, by the
    share of d that the spring takes, at most.
    """
    if config.rate_limited and config.holds and state.status[Status.FAULT] != 0:
        w = state.hold_bandwidth[0]
        for j in range(state.sent.size):
            off, mass, rate = abs(state.hold[Hold.OFFSET, j]), state.inertia[j, j], _SHARE_OF_RATE * config.effort_rate[j]
            if rate > 0.0 and min(off * off * off / (6.0 * rate * rate), off / (3.0 * w * w)) > _DETOUR * mass:
                state.clock[Clock.UNLIMITED] = 1


@inlined
def _follow_blindly(config: ControllerConfig, state: ControllerState) -> None:
    """Compute the effort of the desired motion from the model and from what was learnt beyond it."""
    w, efforts = state.hold_bandwidth[0], state.signals[Signal.EQUIVALENT_EFFORT : Signal.EFFORT + 1]
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
