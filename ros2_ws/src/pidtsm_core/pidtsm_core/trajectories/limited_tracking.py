"""Tracking of a moving target within limits of position, velocity, acceleration and jerk.

The tracked motion has constant jerk in each tick, so its acceleration is continuous, and the limits hold at every time,
whatever the target does. Near the target the jerk is that of a linear law with three equal real poles. Elsewhere it is
the nearest jerk from which no limit and no overshoot becomes unavoidable: from every state the motion can still come to
rest, at full deceleration, within its limits. Far from a resting target the motion is therefore close to time-optimal
(compare Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, chapter 4).
"""

import math
from typing import NamedTuple

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit

POLE = 40.0
"""Pole of the linear law, rad/s."""

_BISECTIONS = 14
"""Jerks are found to 2^-14 of the largest."""
_SLACK = 1e-3
"""Overshoot that the linear law may have, rad; less if it would need more than a tenth of the largest jerk there."""
_LEAST = 0.1
"""Share of the acceleration that is left to approach a target, however fast it accelerates."""
_REST = (1e-9, 1e-8, 1e-6)
"""Closer to rest than this, the motion is at rest: rad, rad/s, rad/s^2."""


class _State(NamedTuple):
    """Position, velocity and acceleration of one joint."""

    q: float
    dq: float
    ddq: float


class _Limits(NamedTuple):
    """Limits of one joint."""

    lower: float
    upper: float
    velocity: float
    acceleration: float
    jerk: float


@njit
def stop_position(state: _State, limits: _Limits) -> float:
    """Position at which the joint comes to rest if it stops as fast as its acceleration and jerk allow."""
    jerk = limits.jerk
    side = 1.0 if state.dq + 0.5 * state.ddq * abs(state.ddq) / jerk >= 0.0 else -1.0
    v, a = side * state.dq, side * state.ddq
    peak = max(min(math.sqrt(max(jerk * v + 0.5 * a * a, 0.0)), limits.acceleration), -a)
    first, last = (a + peak) / jerk, peak / jerk
    v1 = v + 0.5 * (a - peak) * first
    middle = max(v1 - 0.5 * peak * last, 0.0) / peak if peak > 0.0 else 0.0
    v2 = v1 - peak * middle
    way = first * (v + first * (0.5 * a - jerk * first / 6.0)) + middle * (v1 - 0.5 * peak * middle)
    return state.q + side * (way + last * (v2 - 0.5 * peak * last + jerk * last * last / 6.0))


@njit
def _after(state: _State, jerk: float, dt: float) -> _State:
    return _State(
        state.q + dt * (state.dq + dt * (0.5 * state.ddq + dt * jerk / 6.0)),
        state.dq + dt * (state.ddq + 0.5 * dt * jerk),
        state.ddq + dt * jerk,
    )


@njit
def _mirrored(state: _State) -> _State:
    return _State(-state.q, -state.dq, -state.ddq)


@njit
def _stopping_below(bound: float, jerk: float, state: _State, limits: _Limits, dt: float) -> float:
    """The largest jerk, at most `jerk`, after which the stop position is at most `bound`; else the smallest."""
    if stop_position(_after(state, jerk, dt), limits) <= bound:
        return jerk
    low, high = -limits.jerk, jerk
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if stop_position(_after(state, middle, dt), limits) <= bound:
            low = middle
        else:
            high = middle
    return low


@njit
def _stopping_above(bound: float, jerk: float, state: _State, limits: _Limits, dt: float) -> float:
    return -_stopping_below(-bound, -jerk, _mirrored(state), limits, dt)


@njit
def _staying_below(velocity: float, state: _State, limits: _Limits, dt: float) -> float:
    """The jerk after which the joint just reaches this velocity while its acceleration vanishes.

    The acceleration a after the tick solves a |a| / (2 jerk) + a dt / 2 = `velocity` - dq - ddq dt / 2.
    """
    room = velocity - state.dq - 0.5 * dt * state.ddq
    a = limits.jerk * (math.sqrt(0.25 * dt * dt + 2.0 * abs(room) / limits.jerk) - 0.5 * dt)
    a = min(a, limits.acceleration) if room >= 0.0 else -a
    return (a - state.ddq) / dt


@njit
def _beside(acceleration: float, limits: _Limits) -> _Limits:
    """Limits of what a joint does beside the acceleration of its target."""
    left = max(limits.acceleration - abs(acceleration), _LEAST * limits.acceleration)
    return _Limits(limits.lower, limits.upper, limits.velocity, left, limits.jerk)


@njit
def _jerk(state: _State, error: _State, limits: _Limits, dt: float) -> float:
    """The jerk of a joint for one tick; `error`: state minus that of the target."""
    largest = limits.jerk
    jerk = -POLE * (POLE * (POLE * error.q + 3.0 * error.dq) + 3.0 * error.ddq)
    jerk = min(max(jerk, -largest), largest)

    # Relative to the target: neither past it nor, far from it, back before reaching it.
    relative, spare, cube = error, _beside(state.ddq - error.ddq, limits), POLE * POLE * POLE
    slack = min(_SLACK, 0.1 * largest / cube)
    far = abs(error.q) > largest / cube
    committed = relative.dq + 0.5 * relative.ddq * abs(relative.ddq) / largest
    margin = 5.0 * largest * dt * dt
    if error.q < 0.0:
        if far and committed > -margin:
            jerk = max(jerk, -_staying_below(0.0, _mirrored(relative), spare, dt))
        jerk = _stopping_below(slack, jerk, relative, spare, dt)
    else:
        if far and committed < margin:
            jerk = min(jerk, _staying_below(0.0, relative, spare, dt))
        jerk = _stopping_above(-slack, jerk, relative, spare, dt)

    # A tick is an even step, so velocities are limited with a margin of one.
    fastest = limits.velocity - largest * dt * dt
    jerk = min(jerk, _staying_below(fastest, state, limits, dt))
    jerk = max(jerk, -_staying_below(fastest, _mirrored(state), limits, dt))
    # Outside its positions a joint may move inwards.
    stop = stop_position(state, limits)
    jerk = _stopping_below(max(limits.upper, stop), jerk, state, limits, dt)
    jerk = _stopping_above(min(limits.lower, stop), jerk, state, limits, dt)
    jerk = min(max(jerk, (-limits.acceleration - state.ddq) / dt), (limits.acceleration - state.ddq) / dt)
    return min(max(jerk, -largest), largest)


@njit
def track(state: Array, target: Array, limits: Array, dt: float) -> None:
    """Advance a motion by one tick.

    Args:
        state: q, q', q'' of the motion, shape (3, joints), rad, rad/s, rad/s^2; overwritten.
        target: the same of the target.
        limits: lower and upper position, velocity, acceleration, jerk, shape (5, joints); the last two finite.
        dt: tick, s, at most about 1 ms.
    """
    for j in range(state.shape[1]):
        limit = _Limits(limits[0, j], limits[1, j], limits[2, j], limits[3, j], limits[4, j])
        present = _State(state[0, j], state[1, j], state[2, j])
        velocity, acceleration = target[1, j], target[2, j]
        if abs(velocity) > limit.velocity:
            # It cannot be followed: go where it is.
            velocity, acceleration = 0.0, 0.0
        acceleration = min(max(acceleration, -limit.acceleration), limit.acceleration)
        error = _State(present.q - target[0, j], present.dq - velocity, present.ddq - acceleration)
        resting = velocity == 0.0 and acceleration == 0.0
        if resting and abs(error.q) < _REST[0] and abs(error.dq) < _REST[1] and abs(error.ddq) < _REST[2]:
            present = _State(target[0, j], 0.0, 0.0)
        else:
            present = _after(present, _jerk(present, error, limit, dt), dt)
        state[0, j], state[1, j], state[2, j] = present.q, present.dq, present.ddq
