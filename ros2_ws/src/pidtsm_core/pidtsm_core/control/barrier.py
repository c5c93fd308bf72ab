"""A barrier before the limits of position and velocity, that no reference and no hand gets past.

A joint may move towards the end of its range at most with ``barrier.approach`` times the distance that is left, and at
most with its velocity limit. These are control barrier functions h >= 0, kept by h' + gain h >= 0 (Ames et al.,
"Control barrier functions: Theory and applications", ECC 2019, eq. (9)), here for the acceleration that the effort
causes by the model: where it would break one, the effort is changed by just what that joint's acceleration needs.
"""

import math

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.effort import limit_effort
from pidtsm_core.control.joint_friction import friction
from pidtsm_core.control.state import ControllerState, External, part
from pidtsm_core.robots import forward_dynamics, inverse_dynamics
from pidtsm_core.signals import Limited, Mode, Signal, Status

_STIFFER = 4.0
"""How many times faster than the approach a velocity that is too high is braked."""
_FASTEST = 0.97
"""Share of the velocity limit at which the barrier stands, so that the arm does not stop."""
_FOLLOWS = 0.05
"""A joint whose velocity is that near to the desired one, rad/s, follows."""
_NEAR = 0.5
"""rad/s; a joint whose velocity is farther from what its barrier allows is not held back."""
_PASSES = 4
"""How often the accelerations are fitted to the effort limits; the joints are coupled."""
_BY_BARRIER = float(Limited.BARRIER)


@part
def keep_inside(config: ControllerConfig, state: ControllerState) -> None:
    """Change the efforts of the signals so that no joint breaks its barrier; others accelerate as before.

    The integrals of a joint that is held back pause, as they do where an effort is limited. What acts from outside
    counts as far as it is known (with ``limits.external_effort``), so that a steady push ends at the barrier.
    """
    if config.compensates and state.status[Status.MODE] != Mode.FREEDRIVE:
        _note_friction(config, state)
    if not _correct(config, state):
        return
    y, motion, efforts = state.signals, state.motion, state.scratch
    for j in range(motion.shape[1]):
        efforts[5, j] = 0.0
    for _ in range(_PASSES):
        inverse_dynamics(config.model, y[Signal.POSITION], efforts[5], motion[:2], efforts[:2])
        if not _is_less(config, state):
            break
    for j in range(motion.shape[1]):
        y[Signal.EFFORT, j] += efforts[1, j] - efforts[0, j]
    limit_effort(config, state)
    for j in range(motion.shape[1]):
        if motion[1, j] != 0.0:
            y[Signal.SATURATED, j] += _BY_BARRIER


@inlined
def _is_less(config: ControllerConfig, state: ControllerState) -> bool:
    """Brake a joint only as much as its effort limit allows; whether that is less than before.

    Otherwise the efforts of the others would make up for an acceleration that does not come, and push it on.
    """
    motion, efforts, less = state.motion, state.scratch, False
    for j in range(motion.shape[1]):
        effort, limit, change = state.signals[Signal.EFFORT, j], config.limits.effort[j], efforts[1, j] - efforts[0, j]
        possible = min(max(change, -limit - effort), limit - effort)
        if motion[1, j] != 0.0 and possible != change:
            motion[1, j] *= max(possible / change, 0.0)
            less = True
    return less


@inlined
def _note_friction(config: ControllerConfig, state: ControllerState) -> None:
    """Note as compensated the friction that a joint has which is held back, not that of its desired velocity.

    The latter is free of noise, so it counts for a joint that follows, and for one that is far from its barrier.
    """
    for j in range(state.added.size):
        desired, estimated = state.desired[1, j], state.signals[Signal.VELOCITY, j]
        low, high = _allowed_velocities(config, state.signals[Signal.POSITION, j], j)
        if low + _NEAR < estimated < high - _NEAR:
            continue
        likely = min(max(desired, estimated - _FOLLOWS), estimated + _FOLLOWS)
        if likely != desired:
            state.added[j] -= friction(config, desired, j) - friction(config, likely, j)


@inlined
def _correct(config: ControllerConfig, state: ControllerState) -> bool:
    """Write by how much the barriers change the accelerations to ``state.motion[1]``; whether they do."""
    y, motion, efforts = state.signals, state.motion, state.scratch
    q, dq, caused, net = y[Signal.POSITION], y[Signal.VELOCITY], efforts[4], efforts[5]
    for j in range(q.size):
        net[j] = y[Signal.EFFORT, j] - state.added[j] + state.external[External.TWICE, j]
    forward_dynamics(config.model, q, dq, net, caused)
    acts = False
    for j in range(q.size):
        allowed = _allowed(config, q[j], dq[j], caused[j], j)
        motion[0, j] = motion[1, j] = 0.0
        if allowed != caused[j] and math.isfinite(allowed):
            motion[1, j] = allowed - caused[j]
            acts = True
    return acts


@inlined
def _allowed(config: ControllerConfig, q: float, dq: float, caused: float, joint: int) -> float:
    """The acceleration next to the one that is caused that keeps the barriers of a joint, rad/s^2."""
    low, high = _allowed_velocities(config, q, joint)
    gain = _STIFFER * config.barrier.approach
    # Beyond both, which noise may do, towards the middle.
    return min(max(caused, gain * (low - dq)), gain * (high - dq))


@inlined
def _allowed_velocities(config: ControllerConfig, q: float, joint: int) -> tuple[float, float]:
    """The least and the largest velocity that the barriers of a joint allow at q, rad/s."""
    least, most = config.limits.min_position[joint], config.limits.max_position[joint]
    approach, margin, fastest = config.barrier.approach, config.barrier.margin[joint], config.limits.velocity[joint]
    low, high = -math.inf, math.inf
    if margin > 0.0 and least < most:
        margin = min(margin, 0.5 * (most - least))
        high, low = approach * (most - margin - q), approach * (least + margin - q)
    if fastest > 0.0:
        high, low = min(high, _FASTEST * fastest), max(low, -_FASTEST * fastest)
    return low, high
