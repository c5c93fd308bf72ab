"""Freedrive: the arm carries itself, and a person moves it by hand.

A spring and a damper tie each joint to an anchor. Where the spring needs more effort than ``freedrive.resistance``, the
anchor slips along, like dry friction: the arm stays where it is left, even if the model is wrong, and nothing but a
push sets it in motion (the elasto-plastic model of Dupont, Hayward, Armstrong and Altpeter, "Single state elastoplastic
friction models", IEEE Transactions on Automatic Control 47(5), 2002). The anchor moves at ``freedrive.velocity`` at
most, and not out of the range of its joint; beyond, the spring holds the arm back.
"""

from pidtsm_core.compiled import inlined
from pidtsm_core.control.effort import friction, limit_effort
from pidtsm_core.control.safe import go_gently, learn
from pidtsm_core.control.state import Clock, ControllerConfig, ControllerState, Hold, part
from pidtsm_core.robots import forward_dynamics, inverse_dynamics
from pidtsm_core.signals import Signal
from pidtsm_core.timing import seconds

_BANDWIDTH, _OF_RATE = 40.0, 0.1
"""Natural frequency of the springs, rad/s, and its largest value as a multiple of the rate of the joint states."""
_COMPENSATED = 0.7
"""Share of the friction that is compensated: the arm must not move by itself if its friction is less than modelled."""
_MOVES = 0.05
"""rad/s; a joint that is faster slips from the beginning."""
_MARGIN, _LARGEST_MARGIN = 0.05, 0.1
"""Distance of the anchor from a position limit, as a share of the range of the joint; and in rad or m."""


@part
def make_free(config: ControllerConfig, state: ControllerState, stamp: int, dt: float) -> None:
    """Replace the effort for the joint state of `stamp` (ns), dt (s) after the last one, with that of freedrive."""
    y, hold, clock, motion, efforts = state.signals, state.hold, state.clock, state.motion, state.scratch
    q, begins = y[Signal.POSITION], clock[Clock.FREED] == 0
    bandwidth = _BANDWIDTH
    if clock[Clock.PERIOD] > 0:
        bandwidth = min(bandwidth, _OF_RATE / seconds(clock[Clock.PERIOD]))
    if begins:
        _begin(config, state, bandwidth)
        dt = 0.0
    # The inertia changes slowly: that of one joint at each sample is enough.
    _pull(config, state, bandwidth, clock[Clock.ANSWERED] % q.size)
    gravity, pull = efforts[0], efforts[1]
    for j in range(q.size):
        pull[j] -= gravity[j]
        loose = _slip(config, state, j, pull[j] / (bandwidth * bandwidth), pull[j], dt)
        velocity, fastest = y[Signal.VELOCITY, j], config.free_velocity[j]
        allowed = min(max(velocity, -fastest), fastest)
        motion[0, j] = -2.0 * bandwidth * (velocity - loose * allowed)
        state.added[j] = loose * _COMPENSATED * friction(config, allowed, j)
        efforts[5, j] = 0.0
    inverse_dynamics(config.model, q, efforts[5], motion[:1], efforts[3:4])
    for j in range(q.size):
        y[Signal.EQUIVALENT_EFFORT, j] = gravity[j]
        y[Signal.EFFORT, j] = efforts[3, j] + pull[j] + hold[Hold.LEARNT, j] + state.added[j]
    limit_effort(config, state)
    go_gently(config, state, stamp, begins)


@inlined
def _begin(config: ControllerConfig, state: ControllerState, bandwidth: float) -> None:
    """Tie the arm to anchors behind it, where they slip if it moves.

    What the law has learnt of a load is added up to the resistance, so that it cannot move the arm if it is wrong.
    """
    state.clock[Clock.FREED] = 1
    learn(config, state)
    learnt, anchors, stretches = state.hold[Hold.LEARNT], state.hold[Hold.ANCHOR], state.scratch[4]
    q = state.signals[Signal.POSITION]
    for j in range(q.size):
        learnt[j] = min(max(learnt[j], -config.resistance[j]), config.resistance[j])
        anchors[j] = q[j]
    for j in range(q.size):
        _pull(config, state, bandwidth, j)
        share = min(max(state.signals[Signal.VELOCITY, j] / _MOVES, -1.0), 1.0)
        state.net[j] = state.scratch[0, j] + share * config.resistance[j]
    forward_dynamics(config.model, q, state.scratch[5], state.net, stretches)
    for j in range(q.size):
        anchors[j] -= stretches[j] / (bandwidth * bandwidth)


@part
def _pull(config: ControllerConfig, state: ControllerState, bandwidth: float, joint: int) -> None:
    """Write the effort that carries the arm, and that with the springs, to ``state.scratch``; weigh a joint."""
    motion, efforts, q = state.motion, state.scratch, state.signals[Signal.POSITION]
    for j in range(q.size):
        motion[0, j] = motion[2, j] = efforts[5, j] = 0.0
        motion[1, j] = bandwidth * bandwidth * (state.hold[Hold.ANCHOR, j] - q[j])
    motion[2, joint] = 1.0
    inverse_dynamics(config.model, q, efforts[5], motion, efforts[:3])
    state.hold[Hold.INERTIA, joint] = efforts[2, joint] - efforts[0, joint]


@inlined
def _slip(
    config: ControllerConfig, state: ControllerState, joint: int, weighted: float, pull: float, dt: float
) -> float:
    """Move the anchor of a joint over dt (s).

    Args:
        config: configuration, which is read.
        state: state, which is changed.
        joint: index of the joint.
        weighted: `pull` by the square of the bandwidth, kg m^2 rad.
        pull: effort of the springs on the joint, N m.
        dt: s.

    Returns:
        How loose the joint is: from 0, where the damper acts, to 1, where it slips and only its resistance acts.
    """
    resistance, velocity = config.resistance[joint], state.signals[Signal.VELOCITY, joint]
    share = min(max(pull, -resistance), resistance) / pull if pull != 0.0 else 1.0
    inertia = state.hold[Hold.INERTIA, joint]
    # A change of one spring pulls at all joints; this share of it always converges (Jacobi's iteration).
    slip = -(1.0 - share) * weighted / (inertia * config.resistance.size) if inertia > 0.0 else 0.0
    most = config.free_velocity[joint] * dt
    slip = min(max(slip, -most), most)
    if _leaves_range(config, state.hold[Hold.ANCHOR, joint] + slip, slip, joint):
        return 0.0
    state.hold[Hold.ANCHOR, joint] += slip
    return min(abs(pull) / resistance, 1.0) if pull * velocity < 0.0 else 0.0


@inlined
def _leaves_range(config: ControllerConfig, anchor: float, direction: float, joint: int) -> bool:
    """Whether an anchor at this position (rad) that moves in this direction is too near to a position limit."""
    low, high = config.min_position[joint], config.max_position[joint]
    margin = min(_MARGIN * (high - low), _LARGEST_MARGIN)
    too_near = (direction > 0.0 and anchor > high - margin) or (direction < 0.0 and anchor < low + margin)
    return low != high and too_near


@part
def hand_over(state: ControllerState) -> None:
    """Apply the effort of freedrive once more; what it is beyond that of the law stays until the next approach."""
    efforts = state.signals[Signal.EFFORT]
    for j in range(efforts.size):
        beyond = state.sent[j] - efforts[j]
        state.handed[j] = state.handed_before[j] = beyond
        efforts[j] = state.sent[j]
    state.clock[Clock.FREED] = 0
