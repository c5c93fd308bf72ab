"""A joint that leaves rest: friction held it there one way, and acts the other way once it moves.

While a joint sticks, friction balances whatever acts on it, so the observer finds the disturbance that balances the
effort, whatever that is. The law rejects it, and so the effort winds up until the joint breaks away. If the reference
sets off before that, the effort is wrong by up to twice the friction, and a joint with gears falls behind by some 50
mrad until the observer has found out.

Once the joint moves, the disturbance will be about what it was in motion in that direction. So while the reference sets
off, the disturbance gets the difference, by the share tanh(v / v0) with which the compensation of Coulomb friction sets
in at the velocity v of the reference. The observer goes on meanwhile, so an error of the mean, where the joint carries
something else than before, decays like any other error. A joint whose difference is more than static friction explains
is left alone. If the joint has moved in the other direction only, the mean is that of the other; if it has not moved
yet, if it touches something, or is led by hand, nothing changes. Nor does it where a reference reverses without a rest.

The law's own integrals pause at rest: they would wind up, too, and rejecting the disturbance integrates anyway.

Integrators that wind up against static friction: Armstrong-Helouvry, Dupont and Canudas de Wit, "A survey of models,
analysis tools and compensation methods for the control of machines with friction", Automatica 30(7), 1994.
"""

import math

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.compliance import yielding_rate
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.contact import in_contact
from pidtsm_core.control.joint_friction import REVERSAL
from pidtsm_core.control.rests import BACK, FORTH
from pidtsm_core.control.state import ControllerState, Friction, Time, part
from pidtsm_core.estimators import DISTURBANCE
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.signals import Signal, Status

_STANDS, _MOVES = 0.1 * REVERSAL, 3.0 * REVERSAL
"""rad/s; a reference that is slower stands still, and one that is faster takes the joint along."""
_RESTED = 0.05
"""s, from which on a reference that stands still rests."""
_FOLLOWS = 0.5
"""Least velocity of a joint that moves along, relative to that of the reference."""
_MEAN = 0.5
"""s of motion, over which the disturbance is averaged."""
_MOST = 2.0
"""Largest difference that static friction explains, relative to the compensated friction."""


@part
def break_away(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Let the joints whose references leave rest begin with what they were in motion; dt (s) is since the last tick.

    It changes the disturbance that the observer has found.
    """
    rests, begins = state.rests, False
    works = state.status[Status.FAULT] == 0 and state.times[Time.FREED] == 0 and not in_contact(config, state)
    for j in range(state.measured.size):
        velocity = _velocity(state, j)
        state.accelerations[0, j] = state.accelerations[1, j] = state.motion[2, j] = 0.0
        if not works or abs(velocity) < _STANDS:
            rests.rested[j] = rests.rested[j] + dt if works else 0.0
            if rests.rested[j] > _RESTED:
                rests.change[j] = 0.0
            continue
        if rests.rested[j] > _RESTED:
            begins = True
            _begin(state, j, FORTH if velocity > 0.0 else BACK)
        rests.rested[j] = 0.0
        if abs(velocity) > _MOVES:
            rests.change[j] = 0.0
            _learn(state, j, velocity, dt)
    if begins:
        _doubt(config, state)
    for j in range(state.measured.size):
        if rests.change[j] != 0.0:
            more = max(math.tanh(abs(_velocity(state, j)) / REVERSAL) - rests.share[j], 0.0)
            rests.share[j] += more
            state.estimator[j, DISTURBANCE] += more * rests.change[j]


@inlined
def is_at_rest(state: ControllerState, j: int) -> bool:
    """Whether the reference of joint j rests, so that friction may hold the joint."""
    return state.rests.rested[j] > _RESTED


@inlined
def forget_rests(state: ControllerState) -> None:
    """Begin anew: what was learnt in motion was with other parameters, or carrying something else."""
    rests = state.rests
    for j in range(rests.rested.size):
        rests.moved[FORTH, j] = rests.moved[BACK, j] = 0.0
        rests.rested[j] = rests.change[j] = 0.0


@inlined
def _velocity(state: ControllerState, j: int) -> float:
    """Velocity of the reference of joint j, without that with which it yields, rad/s."""
    return state.desired[1, j] - yielding_rate(state, j)


@inlined
def _begin(state: ControllerState, j: int, way: int) -> None:
    """Find what joint j needs to be as it was in motion; nothing if that is not known."""
    rests, found = state.rests, state.estimator[j, DISTURBANCE]
    if rests.moved[way, j] == 0.0:
        way = FORTH + BACK - way
    known = rests.moved[way, j] > 0.0 and math.isfinite(found)
    rests.change[j] = rests.disturbance[way, j] - found if known else 0.0
    rests.share[j] = 0.0
    state.accelerations[0, j] = rests.change[j]


@inlined
def _learn(state: ControllerState, j: int, velocity: float, dt: float) -> None:
    """Average the disturbance over dt (s) if joint j moves along with its reference at a velocity (rad/s)."""
    rests, found = state.rests, state.estimator[j, DISTURBANCE]
    follows = state.signals[Signal.VELOCITY, j] * velocity > _FOLLOWS * velocity * velocity
    if follows and math.isfinite(found):
        way = FORTH if velocity > 0.0 else BACK
        rests.moved[way, j] += dt
        gone = max(dt / rests.moved[way, j], -math.expm1(-dt / _MEAN))
        rests.disturbance[way, j] += gone * (found - rests.disturbance[way, j])


@inlined
def _doubt(config: ControllerConfig, state: ControllerState) -> None:
    """Drop the changes that begin, ``state.accelerations[0]``, where friction does not explain them."""
    rests, efforts, q = state.rests, state.scratch, state.signals[Signal.POSITION]
    inverse_dynamics(config.model, q, state.motion[2], state.accelerations, efforts[:2])
    for j in range(state.measured.size):
        most = _MOST * (config.compensation.coulomb[j] + state.friction[Friction.USED, j])
        if state.accelerations[0, j] != 0.0 and abs(efforts[0, j] - efforts[1, j]) > most:
            rests.change[j] = 0.0
