"""The safe effort of a controller that has stopped: it holds or damps the arm, depending on ``stop.effort``.

Holding is a spring, a damper and an integral that tie the arm to a motion that comes to rest. Stiffness and damping are
the inertia of the model where the arm was stopped, times constants. They are symmetric and positive, so the damper
takes energy out of arm and spring, whatever the true inertia is; docs/stops.md weighs what the integral and a wrong
load put in. Where the arm does not obey, supervision.py gives up holding.
"""

import math

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.desired import write_desired
from pidtsm_core.control.effort import LARGEST_CHANGE, add_offset, added_gravity, carry, feed_offset, limit_effort
from pidtsm_core.control.state import Condition, ControllerState, Held, Hold, Time, part
from pidtsm_core.control.stopping import DETOUR, SLOWEST, begin_hold, learn, resume_hold
from pidtsm_core.control.supervision import damp_inertia, gives_up, supervise
from pidtsm_core.control.trust import is_doubtful, reverse, used_position
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.signals import Fault, Signal, Status, Stop
from pidtsm_core.timing import NANOSECONDS, seconds

_CUTOFF = 10.0
"""Cutoff of the velocity filter, as a multiple of the bandwidth of the position control."""
_LONGEST_CHANGE = 0.01
"""s; longest time between two commands that counts for this."""
_AT_REST = 0.02  # rad/s
_SETTLES, _WEIGHS, _WEIGHING = 0.03, 0.3, 2.0
"""s, s; the load is weighed between these times after the stop. Rate, relative to the bandwidth of the hold."""
_LONGEST_PERIOD = NANOSECONDS // 300
"""ns; an arm that is measured less often is not weighed."""
_ASTRAY, _GOES_ON, _DROPS = 0.02, 0.1, 2.0
"""rad; distance of a joint from its place beyond which what was learnt may drive it away. Least velocity of a joint
that goes on, relative to that at the stop. Rate at which what drives it fades, relative to the bandwidth."""
_MOVES = 0.001
"""rad; largest way that the difference between the last command and the safe effort alone would move the arm."""
_SHARE_OF_RATE = 0.5
"""Share of a rate limit in which the difference fades."""


@part
def make_safe(config: ControllerConfig, state: ControllerState, stamp: int, dt: float) -> None:
    """Replace the effort for the joint state of `stamp` (ns), dt (s) after the last one, with the safe effort."""
    _add_only_offset(config, state)
    if config.stop.holds:
        _hold(config, state, stamp, dt)
        supervise(state, stamp)
    else:
        _damp(config, state)
    if config.stop.brakes:
        _engage_brakes(config, state)


@part
def make_safe_blindly(config: ControllerConfig, state: ControllerState, now: int) -> None:
    """Replace the effort with the safe one while no joint state arrives, at `now` (ns, in the time of the stamps).

    The effort follows from the model and from what was learnt: it stops the arm from its last known motion, then holds
    it. Meanwhile it fades.
    """
    conditions, times = state.conditions, state.times
    _add_only_offset(config, state)
    conditions[Condition.BRAKES] = config.stop.brakes
    if not config.stop.holds:
        _damp(config, state)
        return
    begins = times[Time.SILENT_SINCE] == 0
    if begins:
        times[Time.SILENT_SINCE] = now + 1
        if conditions[Condition.HELD] == Held.NOT:
            begin_hold(config, state, times[Time.LAST])
    write_desired(state, now)
    gone = seconds(now + 1 - times[Time.SILENT_SINCE])
    left = max(0.0, 1.0 - gone / config.stop.fade) if config.stop.fade > 0.0 else 1.0
    _follow_blindly(config, state)
    _fade(config, state, left)
    limit_effort(config, state)
    go_gently(config, state, now, begins)
    conditions[Condition.HELD] = Held.UNSEEN
    state.status[Status.STOP_STAGE] = Stop.BLIND


@inlined
def _add_only_offset(config: ControllerConfig, state: ControllerState) -> None:
    """The safe effort compensates no friction, and feeds nothing forward but offsets; the estimator must know."""
    for j in range(state.added.size):
        state.added[j] = 0.0
    feed_offset(config, state)


@inlined
def _fade_distrusted(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Fade the effort of joints that are not trusted; what the arm's firmware adds remains."""
    efforts, blind = state.signals[Signal.EFFORT], False
    for j in range(efforts.size):
        blind = blind or state.hold[Hold.DISTRUSTED, j] != 0.0
    if not blind or config.stop.fade <= 0.0:
        return
    added = state.scratch[0]
    if config.robot_adds_gravity:
        added_gravity(config, state)
    for j in range(efforts.size):
        if state.hold[Hold.DISTRUSTED, j] != 0.0:
            state.hold[Hold.BLIND, j] += dt
            least = added[j] if config.robot_adds_gravity else 0.0
            efforts[j] = least + max(0.0, 1.0 - state.hold[Hold.BLIND, j] / config.stop.fade) * (efforts[j] - least)


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
    if not config.stop.holds:
        _damp(config, state)
        return
    if state.conditions[Condition.HELD] == Held.NOT:
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
        y[Signal.EFFORT, j] *= config.stop.gravity
    if config.robot_adds_gravity and config.stop.gravity == 0.0:
        added_gravity(config, state)
        for j in range(y.shape[1]):
            y[Signal.EFFORT, j] = added[j]
    for j in range(y.shape[1]):
        y[Signal.EFFORT, j] -= config.stop.damping[j] * y[Signal.VELOCITY, j]
    limit_effort(config, state)


@inlined
def _hold(config: ControllerConfig, state: ControllerState, stamp: int, dt: float) -> None:
    """Tie the arm to its way to rest by spring, damper and integral, all poles at the bandwidth."""
    y, hold = state.signals, state.hold
    begins = state.conditions[Condition.HELD] != Held.HERE
    if begins:
        if state.conditions[Condition.HELD] != Held.UNSEEN or not resume_hold(config, state, stamp):
            begin_hold(config, state, stamp)
        dt = 0.0
    w = state.hold_bandwidth[0]
    _filter_motion(config, state, dt)
    if gives_up(state):
        damp_inertia(config, state)
    else:
        efforts = y[Signal.EQUIVALENT_EFFORT : Signal.EQUIVALENT_EFFORT + 1]
        inverse_dynamics(config.model, hold[Hold.POSITION], state.desired[1], state.desired[2:], efforts)
        add_offset(config, efforts, 1.0)
        if state.times[Time.PERIOD] <= _LONGEST_PERIOD:
            weigh_load(config, state, dt)
        for j in range(state.measured.size):
            hold[Hold.WEIGHED, j] += dt
        _drop_what_drives_away(state, dt)
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
def _drop_what_drives_away(state: ControllerState, dt: float) -> None:
    """Let what was learnt fade where a joint goes on in its direction: friction and inertia do not hold the arm.

    If the joint then falls beyond its place, it was a load after all, and returns. After a gap, the velocity at the
    stop is not known.
    """
    if state.status[Status.FAULT] == Fault.STATE_STALE:
        return
    hold, passed = state.hold, -math.expm1(-_DROPS * state.hold_bandwidth[0] * dt)
    for j in range(state.measured.size):
        e, de = hold[Hold.POSITION, j] - state.desired[0, j], hold[Hold.VELOCITY, j] - state.desired[1, j]
        learnt, dropped, before = hold[Hold.LEARNT, j], hold[Hold.DROPPED, j], hold[Hold.BEFORE, j]
        if is_doubtful(state, j) or abs(e) < _ASTRAY or e * de < 0.0:
            continue
        change = 0.0
        if e * learnt > 0.0 and de * before > _GOES_ON * before * before and hold[Hold.WEIGHED, j] < _WEIGHS:
            change = passed * learnt
        elif e * dropped < 0.0:
            change = -passed * dropped
        hold[Hold.DROPPED, j] += change
        hold[Hold.LEARNT, j] -= change


@part
def weigh_load(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Learn the load from what the arm does in the first moments of a stop, dt (s) after the last sample.

    The load approaches the effort that neither the model nor the motion explains. This effort is filtered as the
    velocity is, and so comes as late. While a joint is doubtful or at its limit, none is weighed: its motion, or what
    keeps it from moving as desired, would count as a load of the others.
    """
    hold, filtered = state.hold, -math.expm1(-_CUTOFF * state.hold_bandwidth[0] * dt)
    rate, weighs = _WEIGHING * state.hold_bandwidth[0], True
    for j in range(state.measured.size):
        weighs = weighs and not is_doubtful(state, j) and abs(state.sent[j]) < config.limits.effort[j]
    for j in range(state.measured.size):
        needed, spent = state.signals[Signal.EQUIVALENT_EFFORT, j], 0.0
        for k in range(state.measured.size):
            needed -= state.inertia[j, k] * state.desired[2, k]
            spent += state.inertia[j, k] * (hold[Hold.VELOCITY, k] - hold[Hold.LAST, k])
        if dt == 0.0:  # The hold begins, perhaps not for the first time.
            hold[Hold.NET, j], spent = state.sent[j] - needed, 0.0
        hold[Hold.NET, j] += filtered * (state.sent[j] - needed - hold[Hold.NET, j])
        if weighs and _SETTLES < hold[Hold.WEIGHED, j] < _WEIGHS:
            unexplained = (hold[Hold.NET, j] - hold[Hold.LEARNT, j]) * dt - spent
            learnt = hold[Hold.LEARNT, j] + rate * unexplained
            hold[Hold.LEARNT, j] = min(max(learnt, -config.limits.effort[j]), config.limits.effort[j])
    for j in range(state.measured.size):
        hold[Hold.LAST, j] = hold[Hold.VELOCITY, j]


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
    reverse(state, dt)


@inlined
def _integrate(state: ControllerState, dt: float) -> None:
    """Let the integral of the error grow while the effort can follow it."""
    if state.conditions[Condition.BRAKES] == 0 and state.conditions[Condition.SLEWING] == 0 and not gives_up(state):
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
    state.conditions[Condition.SLEWING] = 0
    if begins:
        for j in range(efforts.size):
            offset[j] = state.sent[j] - efforts[j]
        _hurry(config, state)
        _judge_rate_limit(config, state)
    since = min(max(seconds(now - state.times[Time.SENT]), 0.0), _LONGEST_CHANGE)
    for j in range(efforts.size):
        change = _fading_rate(config, state, j) * since
        offset[j] -= min(max(offset[j], -change), change)
        limit, last = config.limits.effort[j], state.sent[j]
        low, high = max(last - LARGEST_CHANGE * limit, -limit), min(last + LARGEST_CHANGE * limit, limit)
        wanted = efforts[j] + offset[j]
        efforts[j] = min(max(wanted, low), high)
        state.conditions[Condition.SLEWING] |= int(efforts[j] != wanted)


@inlined
def _hurry(config: ControllerConfig, state: ControllerState) -> None:
    """Let the difference fade so soon that it does not move the arm by much, see `_judge_rate_limit`."""
    for j in range(state.sent.size):
        off, inertia = abs(state.hold[Hold.OFFSET, j]), state.inertia[j, j]
        if inertia > 0.0 and off > 0.0:
            rate = math.sqrt(off * off * off / (6.0 * inertia * _MOVES))
            state.hold_pace[0] = min(state.hold_pace[0], config.limits.effort[j] / rate)


@inlined
def _fading_rate(config: ControllerConfig, state: ControllerState, joint: int) -> float:
    """Rate at which the difference of a joint fades, N m/s."""
    rate = config.limits.effort[joint] / (state.hold_pace[0] if state.hold_pace[0] > 0.0 else SLOWEST)
    limited = (
        state.status[Status.FAULT] != 0
        and config.limits.effort_rate[joint] > 0.0
        and state.conditions[Condition.UNLIMITED] == 0
    )
    return min(rate, _SHARE_OF_RATE * config.limits.effort_rate[joint]) if limited else rate


@inlined
def _judge_rate_limit(config: ControllerConfig, state: ControllerState) -> None:
    """Suspend the rate limit if the arm went too far astray while the difference fades within it.

    Without the hold, a difference d that fades at the rate r displaces an inertia m by d^3 / (6 m r^2); with it, by the
    share of d that the spring takes, at most.
    """
    if config.rate_limited and config.stop.holds and state.status[Status.FAULT] != 0:
        w = state.hold_bandwidth[0]
        for j in range(state.sent.size):
            off, rate = abs(state.hold[Hold.OFFSET, j]), _SHARE_OF_RATE * config.limits.effort_rate[j]
            if rate > 0.0:
                weighted = min(off * off * off / (6.0 * rate * rate), off / (3.0 * w * w))  # way times inertia
                state.conditions[Condition.UNLIMITED] |= int(weighted > DETOUR * state.inertia[j, j])


@inlined
def _follow_blindly(config: ControllerConfig, state: ControllerState) -> None:
    """Compute the effort of the desired motion from the model and from what was learnt beyond it."""
    w, efforts = state.hold_bandwidth[0], state.signals[Signal.EQUIVALENT_EFFORT : Signal.EFFORT + 1]
    for j in range(state.measured.size):
        state.accelerations[0, j] = state.desired[2, j]
        state.accelerations[1, j] = state.desired[2, j] - w * w * w * state.hold[Hold.INTEGRAL, j]
    inverse_dynamics(config.model, state.desired[0], state.desired[1], state.accelerations, efforts)
    add_offset(config, efforts, 1.0)
    for j in range(state.measured.size):
        efforts[1, j] += state.hold[Hold.LEARNT, j]


@inlined
def _engage_brakes(config: ControllerConfig, state: ControllerState) -> None:
    """Engage the brakes once the arm has come to rest; they stay engaged until the fault is reset."""
    still = state.approach_duration[0] == 0.0
    velocity = state.hold[Hold.VELOCITY] if config.stop.holds else state.signals[Signal.VELOCITY]
    for j in range(velocity.size):
        still = still and abs(velocity[j]) < _AT_REST
    if still:
        state.conditions[Condition.BRAKES] = 1
