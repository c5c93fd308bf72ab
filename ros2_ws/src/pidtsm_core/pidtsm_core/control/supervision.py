"""Supervision of a stopped arm: what it is held by must not be what moves it.

If the arm leaves its place, holding is given up for damping, which dissipates energy whatever the inertia is. If a
joint becomes faster although it is damped, the damping acts on a wrong velocity, or too late: then the arm is only
carried by the model, with weak damping. An arm that has come to rest, or moves on but no faster, is held again, but not
for ever.
"""

import math

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.effort import carry
from pidtsm_core.control.state import Condition, ControllerState, Count, Held, Hold, Time, part
from pidtsm_core.control.trust import REVERSALS, change_sign
from pidtsm_core.signals import Signal, Status, Stop
from pidtsm_core.timing import NANOSECONDS

_LEFT = 0.15
"""rad; an arm that is farther from its way to rest, and leaves it faster than a spring would allow, is not held."""
_RATE, _WEAK = 2.0, 0.25
"""Damping, relative to stop.bandwidth; weak damping, relative to damping."""
_GROWN, _GROWN_BY = 2.0, 0.5
"""Factor, and rad/s, by which a joint has become faster if it is not damped by its damping."""
_GROWN_ENERGY = 1.1
"""Factor by which the kinetic energy has grown then; if it has not, other joints have made the joint faster."""
_SLOW = 0.05
"""rad/s; an arm that is slower is held again."""
_PATIENCE = NANOSECONDS // 2
"""ns after which an arm that gets no faster is held again even if it moves: it sinks because its load is unknown."""
_LARGEST_COUNT = 5
"""How often."""


@inlined
def gives_up(state: ControllerState) -> bool:
    """Whether the arm is not held any more."""
    return state.status[Status.STOP_STAGE] == Stop.DAMPING or state.status[Status.STOP_STAGE] == Stop.GRAVITY


@inlined
def supervise(state: ControllerState, stamp: int) -> None:
    """Choose the stage for the next joint state after that of `stamp` (ns)."""
    stage = state.status[Status.STOP_STAGE]
    if stage == Stop.HOLD:
        if _leaves(state):
            _enter(state, Stop.DAMPING, stamp)
    elif _accelerates(state):
        _enter(state, Stop.DAMPING if _changes_sign(state) else Stop.GRAVITY, stamp)
    elif state.counts[Count.RESTED] < _LARGEST_COUNT:
        since = stamp + 1 - state.times[Time.DEGRADED_SINCE]
        if _fastest(state) < _SLOW or since > _PATIENCE:
            state.counts[Count.RESTED] += 1
            state.conditions[Condition.HELD] = Held.ELSEWHERE


@part
def _enter(state: ControllerState, stage: int, stamp: int) -> None:
    """Enter a stage at `stamp` (ns)."""
    state.status[Status.STOP_STAGE] = stage
    state.times[Time.DEGRADED_SINCE] = stamp + 1
    state.hold_energy[0] = _kinetic_energy(state)
    for j in range(state.measured.size):
        state.hold[Hold.SLOWEST, j] = abs(state.hold[Hold.VELOCITY, j])
        state.hold[Hold.ANCHOR, j] = state.hold[Hold.POSITION, j]


@inlined
def _leaves(state: ControllerState) -> bool:
    """Whether a joint is far from its desired position, and still departs from it quickly."""
    leaves = False
    for j in range(state.measured.size):
        e = state.hold[Hold.POSITION, j] - state.desired[0, j]
        de = state.hold[Hold.VELOCITY, j] - state.desired[1, j]
        leaves = leaves or (abs(e) > _LEFT and de * math.copysign(1.0, e) > state.hold_bandwidth[0] * abs(e))
    return leaves


@inlined
def _fastest(state: ControllerState) -> float:
    """Largest speed of a joint, rad/s."""
    fastest = 0.0
    for j in range(state.measured.size):
        fastest = max(fastest, abs(state.hold[Hold.VELOCITY, j]))
    return fastest


@inlined
def _accelerates(state: ControllerState) -> bool:
    """Whether a joint has become faster since the arm has been damped, and not by what others have lost."""
    grown, energy = False, _kinetic_energy(state)
    for j in range(state.measured.size):
        speed, slowest = abs(state.hold[Hold.VELOCITY, j]), state.hold[Hold.SLOWEST, j]
        state.hold[Hold.SLOWEST, j] = min(speed, slowest)
        grown = grown or speed > _GROWN * slowest + _GROWN_BY
    grown = grown and energy > _GROWN_ENERGY * state.hold_energy[0]
    state.hold_energy[0] = min(state.hold_energy[0], energy)
    return grown


@inlined
def _changes_sign(state: ControllerState) -> bool:
    """Change the sign of a measured motion whose damping accelerates its joint, once; return whether it does.

    Damping takes energy out, so the velocity that it acts on has the wrong sign. A joint whose measurement has never
    jumped keeps its sign: something may push it.
    """
    changes, hold = False, state.hold
    for j in range(state.measured.size):
        grown = abs(hold[Hold.VELOCITY, j]) > _GROWN * hold[Hold.SLOWEST, j] + _GROWN_BY
        if grown and hold[Hold.DISTRUSTED, j] == 0.0 and hold[Hold.SIGN, j] != 0.0 and hold[Hold.DAMPED, j] == 0.0:
            change_sign(state, j)
            hold[Hold.DAMPED, j] = 1.0
            hold[Hold.REVERSED, j] = REVERSALS  # Now the sign is known.
            hold[Hold.INTEGRAL, j] = 0.0
            changes = True
    return changes


@inlined
def _kinetic_energy(state: ControllerState) -> float:
    """Kinetic energy with the inertia of the model where the arm was stopped, J."""
    energy = 0.0
    for j in range(state.measured.size):
        for k in range(state.measured.size):
            energy += 0.5 * state.inertia[j, k] * state.hold[Hold.VELOCITY, j] * state.hold[Hold.VELOCITY, k]
    return energy


@inlined
def damp_inertia(config: ControllerConfig, state: ControllerState) -> None:
    """Compute the effort that carries the arm, minus damping in proportion to the inertia where it was stopped.

    A soft spring to where damping began lets it carry an unknown load, too, unless the damping is weak.
    If a torque limit does not allow all the damping, all joints get the same share of it: each joint limited alone, the
    damping of one could accelerate another.
    """
    y, hold, w = state.signals, state.hold, state.hold_bandwidth[0]
    weak = state.status[Status.STOP_STAGE] == Stop.GRAVITY
    carry(config, state, hold[Hold.POSITION])
    rate, share, damping = _RATE * w * (_WEAK if weak else 1.0), 1.0, state.accelerations[1]
    for j in range(damping.size):
        damping[j] = 0.0
        for k in range(damping.size):
            damping[j] -= rate * state.inertia[j, k] * hold[Hold.VELOCITY, k]
            if not weak:
                pull = w * w * (hold[Hold.POSITION, k] - hold[Hold.ANCHOR, k] + w * hold[Hold.INTEGRAL, k])
                y[Signal.EFFORT, j] -= state.inertia[j, k] * pull
        if not weak:
            y[Signal.EFFORT, j] += hold[Hold.LEARNT, j]
    for j in range(damping.size):
        left = config.limits.effort[j] - math.copysign(1.0, damping[j]) * y[Signal.EFFORT, j]
        if abs(damping[j]) > left:
            share = min(share, max(left, 0.0) / abs(damping[j]))
    for j in range(damping.size):
        y[Signal.EFFORT, j] += share * damping[j]
