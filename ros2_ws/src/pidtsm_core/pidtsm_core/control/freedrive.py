"""Freedrive: the arm carries itself, and a person moves it by hand.

A spring ties each joint to an anchor, and a damper slows it down. Where a spring yields, its anchor slips along, like
dry friction: the arm stays where it is left, even if the model is wrong, and nothing but a push sets it in motion (the
elasto-plastic model of Dupont, Hayward, Armstrong and Altpeter, "Single state elastoplastic friction models", IEEE
Transactions on Automatic Control 47(5), 2002).

With z the distances of the anchors from the joints, H the inertia matrix, w the bandwidth and u the velocities with
which joints yield, the effort beyond gravity is f + d with f = w^2 H z and d = -2.4 w H (q' - c u). Why it gives the
arm no energy:

* The springs store w^2 z' H z / 2. An anchor slips only in the direction in which its spring pulls it, so slipping
  takes f_j times its velocity from this energy, never adds to it, however the joints are coupled.
* The dampers take q' H q' - c q' H u, where c is 1, or less so that this is not negative. A joint that yields is not
  damped up to ``freedrive.velocity``. (To scale rows and columns of H instead, as in S H S with a diagonal S, takes
  energy too, but then light modes are damped faster than at 2.4 w, up to that times the condition number of H, which
  no sampled loop can do.)
* Friction is compensated only while an anchor slips, and only by a share of the effort with which its spring brakes.

That is exact in continuous time, but for the change of H over the length of a spring. Sampling, delay and quantisation
cost energy, which a real mass-spring system needs damping for: a sampled spring-damper K, B at period T is passive only
if the joint has the damping b > K T / 2 + |B| itself (Colgate and Schenkel, "Passivity of a class of sampled-data
systems", Journal of Robotic Systems 14(1), 1997), and a resolution of D costs up to K D / 2 of Coulomb friction
(Diolaiti, Niemeyer, Barbagli and Salisbury, "Stability of haptic rendering", IEEE Transactions on Robotics 22(2),
2006). An arm without friction has neither. But its inertia is known, and is what f and d are weighted with, so by the
model each mode obeys z'' + 2.4 w z' + w^2 z = 0, however light it is, and a total delay of 0.4 / w turns its phase by
less than its margin. Hence `_OF_RATE`. If no link is lighter than the model by more than a factor, neither is a mode.

Light joints yield by the length of their springs (`_longest`): the resistance of ``freedrive.resistance`` would hurl
them, and stretch the spring over radians.

Beyond ``freedrive.velocity`` the dampers brake a joint that a push accelerates with a to about freedrive.velocity +
a / (2.4 w). The estimator knows no push, so the measured velocity counts where both differ by more than its noise.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.effort import add_offset, feed_offset, limit_effort
from pidtsm_core.control.joint_friction import friction
from pidtsm_core.control.state import ControllerState, Count, Hold, Time, part
from pidtsm_core.control.stopping import learn
from pidtsm_core.robots import forward_dynamics, inverse_dynamics
from pidtsm_core.signals import Signal
from pidtsm_core.timing import seconds

_BANDWIDTH, _OF_RATE = 40.0, 0.08
"""Natural frequency w of the springs, rad/s, and its largest value as a multiple of the rate of the joint states."""
_DAMPING = 2.4
"""Twice the damping ratio."""
_RECOIL = 2.0
"""Length at which a spring yields, as a multiple of freedrive.velocity / w: let go, it recoils at 0.7 times that."""
_SETTLES = 6.0
"""Rate at which an anchor slips to where its spring does not yield, as a multiple of w; it damps without any delay."""
_CUTOFF, _NOISE = 4.0, 0.25
"""Cutoff of the measured velocities, as a multiple of w; rad/s, what a step of a 12 bit encoder is then at most."""
_MOVES, _TRUSTED = 0.05, 0.9
"""What was learnt while a joint was faster (rad/s) may be wrong, and counts up to this share of the resistance."""
_COMPENSATED = 0.7
"""Share of the friction that is compensated: the arm must not move by itself if its friction is less than modelled."""
_MARGIN, _LARGEST_MARGIN = 0.05, 0.1
"""Distance from a position limit at which the anchor stops, as a share of the range of the joint; and in rad or m."""
_BRAKES = 0.5
"""Rate at which an anchor slows down before that, as a multiple of w."""
_CREEPS = 0.02
"""rad/s; a joint that yields more slowly is damped."""
_EASES = 0.08
"""s; time in which the dampers begin to act."""
_CHANGE = 0.02
"""Largest change from one command to the next, as a share of the effort limit, where freedrive begins."""
_CARRIED = 0.95
"""Largest share of the effort limit that the weight of the arm may take."""
_WRONG = 0.125
"""Error of the model, as a share of gravity, with which the springs must hold the arm."""
_NEAR = 0.5
"""rad or m; distance of the positions that are examined beside the present one."""


@part
def make_free(config: ControllerConfig, state: ControllerState, stamp: int, dt: float) -> None:
    """Replace the effort for the joint state of `stamp` (ns), dt (s) after the last one, with that of freedrive."""
    y, hold, times, counts, efforts = state.signals, state.hold, state.times, state.counts, state.scratch
    begins, bandwidth = times[Time.FREED] == 0, _bandwidth(state)
    if begins:
        _begin(config, state, stamp)
        dt = 0.0
    _measure(state, bandwidth, dt)
    # The inertia changes slowly: that of one joint at each sample is enough.
    _weigh(config, state, counts[Count.ANSWERED] % y.shape[1])
    _pull(config, state, bandwidth)
    _slip(config, state, bandwidth, dt)
    _damp(config, state, bandwidth, _eased(state, stamp))
    gravity, pull, damping = efforts[0], efforts[1], efforts[3]
    share = _possible(config, state)
    for j in range(y.shape[1]):
        state.added[j] = _compensation(config, state, j, pull[j])
        y[Signal.EQUIVALENT_EFFORT, j] = gravity[j]
        y[Signal.EFFORT, j] = gravity[j] + share * (pull[j] + damping[j]) + hold[Hold.LEARNT, j] + state.added[j]
    feed_offset(config, state)  # It is a part of what carries the arm, so it is in the effort already.
    limit_effort(config, state)
    _ease(config, state, begins)
    limit_effort(config, state)


@inlined
def _begin(config: ControllerConfig, state: ControllerState, stamp: int) -> None:
    """Tie the arm to anchors where it is, and limit what the law has learnt of a load.

    It may be wrong, so it is no more than what the springs hold back: on its joint, and on every joint that it moves.
    """
    hold, y, efforts, bandwidth = state.hold, state.signals, state.scratch, _bandwidth(state)
    state.times[Time.FREED] = stamp + 1
    learn(config, state)
    for j in range(hold.shape[1]):
        _weigh(config, state, j)
        hold[Hold.ANCHOR, j] = y[Signal.POSITION, j]
        hold[Hold.SLIP, j] = 0.0
    _pull(config, state, bandwidth)
    for j in range(hold.shape[1]):
        most = _trust(state, j) * _held(config, state, bandwidth, j)
        hold[Hold.LEARNT, j] = min(max(hold[Hold.LEARNT, j], -most), most)
        state.net[j] = efforts[0, j] + hold[Hold.LEARNT, j]
    add_offset(config, state.net.reshape((1, -1)), -1.0)
    forward_dynamics(config.model, y[Signal.POSITION], efforts[5], state.net, efforts[4])
    share = 1.0
    for j in range(hold.shape[1]):
        most = bandwidth * bandwidth * _longest(config, bandwidth, j)
        share = min(share, most / abs(efforts[4, j])) if efforts[4, j] != 0.0 else share
    for j in range(hold.shape[1]):
        hold[Hold.LEARNT, j] *= share


@inlined
def _trust(state: ControllerState, joint: int) -> float:
    """Share of the resistance of a joint up to which something learnt is believed."""
    return 1.0 if abs(state.signals[Signal.VELOCITY, joint]) < _MOVES else _TRUSTED


@inlined
def _eased(state: ControllerState, stamp: int) -> float:
    """Share of the dampers that acts, from 0 at the beginning, so that an arm that moves is not stopped with a jerk."""
    since = seconds(stamp + 1 - state.times[Time.FREED])
    return since / _EASES if 0.0 <= since < _EASES else 1.0


@inlined
def _ease(config: ControllerConfig, state: ControllerState, begins: bool) -> None:
    """Fade from the last command to the effort of freedrive, all joints together."""
    efforts, offset, largest = state.signals[Signal.EFFORT], state.hold[Hold.OFFSET], 0.0
    for j in range(efforts.size):
        if begins:
            offset[j] = state.sent[j] - efforts[j]
        largest = max(largest, abs(offset[j]) / config.limits.effort[j])
    left = max(1.0 - _CHANGE / largest, 0.0) if largest > 0.0 else 0.0
    for j in range(efforts.size):
        offset[j] *= left
        efforts[j] += offset[j]


@inlined
def _measure(state: ControllerState, bandwidth: float, dt: float) -> None:
    """Update the velocities that follow from the measured positions alone, dt (s) after the last ones."""
    hold = state.hold
    passed = -math.expm1(-_CUTOFF * bandwidth * dt)
    for j in range(hold.shape[1]):
        if dt > 0.0:
            difference = (state.measured[j] - hold[Hold.POSITION, j]) / dt
            hold[Hold.VELOCITY, j] += passed * (difference - hold[Hold.VELOCITY, j])
        else:
            hold[Hold.VELOCITY, j] = state.signals[Signal.VELOCITY, j]
        hold[Hold.POSITION, j] = state.measured[j]


@inlined
def _velocity(state: ControllerState, joint: int) -> float:
    """Velocity of a joint, rad/s: the estimated one, unless the measured one differs by more than its noise."""
    estimated = state.signals[Signal.VELOCITY, joint]
    beyond = state.hold[Hold.VELOCITY, joint] - estimated
    return estimated + math.copysign(max(abs(beyond) - _NOISE, 0.0), beyond)


@inlined
def _bandwidth(state: ControllerState) -> float:
    """Natural frequency of the springs, rad/s."""
    period = state.times[Time.PERIOD]
    return min(_BANDWIDTH, _OF_RATE / seconds(period)) if period > 0 else _BANDWIDTH


@inlined
def _held(config: ControllerConfig, state: ControllerState, bandwidth: float, joint: int) -> float:
    """Effort on a joint alone that its spring holds at least, N m."""
    light = bandwidth * bandwidth * _longest(config, bandwidth, joint) * state.hold[Hold.LIGHTEST, joint]
    return min(config.freedrive.resistance[joint], light)


@part
def _weigh(config: ControllerConfig, state: ControllerState, joint: int) -> None:
    """Update the inertias of a joint."""
    motion, efforts, q = state.motion, state.scratch, state.signals[Signal.POSITION]
    for j in range(q.size):
        motion[0, j] = motion[1, j] = efforts[5, j] = 0.0
    motion[1, joint] = 1.0
    inverse_dynamics(config.model, q, efforts[5], motion[:2], efforts[:2])
    state.hold[Hold.INERTIA, joint] = efforts[1, joint] - efforts[0, joint]
    efforts[0, joint] += 1.0
    forward_dynamics(config.model, q, efforts[5], efforts[0], efforts[4])
    state.hold[Hold.LIGHTEST, joint] = 1.0 / efforts[4, joint] if efforts[4, joint] > 0.0 else 0.0


@part
def _pull(config: ControllerConfig, state: ControllerState, bandwidth: float) -> None:
    """Write the effort that carries the arm, and that of the springs, to the first rows of ``state.scratch``."""
    motion, efforts, q = state.motion, state.scratch, state.signals[Signal.POSITION]
    for j in range(q.size):
        motion[0, j] = efforts[5, j] = 0.0
        motion[1, j] = bandwidth * bandwidth * (state.hold[Hold.ANCHOR, j] - q[j])
    inverse_dynamics(config.model, q, efforts[5], motion[:2], efforts[:2])
    for j in range(q.size):
        efforts[1, j] -= efforts[0, j]
    add_offset(config, efforts[:1], 1.0)


@inlined
def _slip(config: ControllerConfig, state: ControllerState, bandwidth: float, dt: float) -> None:
    """Move the anchors over dt (s), one after the other, as far as their springs yield, and not too fast."""
    hold = state.hold
    passed = -math.expm1(-_SETTLES * bandwidth * dt)
    for j in range(hold.shape[1]):
        slip = passed * _excess(config, state, bandwidth, j)
        most = dt * _fastest(config, state, bandwidth, j, slip)
        slip = min(max(slip, -most), most)
        if slip != 0.0:
            hold[Hold.ANCHOR, j] += slip
            _pull(config, state, bandwidth)  # A change of one spring pulls at all joints.
        if dt > 0.0:
            hold[Hold.SLIP, j] += passed * (slip / dt - hold[Hold.SLIP, j])


@inlined
def _stretch(state: ControllerState, joint: int) -> float:
    """Length of a spring, rad; negative if other springs make it pull away from its anchor."""
    stretch = state.hold[Hold.ANCHOR, joint] - state.signals[Signal.POSITION, joint]
    return math.copysign(1.0, state.scratch[1, joint]) * stretch


@inlined
def _excess(config: ControllerConfig, state: ControllerState, bandwidth: float, joint: int) -> float:
    """How far the anchor of a joint has to move until its spring yields no more, rad.

    It moves at most until the spring pulls no more: farther, it would add energy.
    """
    pull, inertia = state.scratch[1, joint], state.hold[Hold.INERTIA, joint]
    if not inertia > 0.0:
        return 0.0
    stiffness = bandwidth * bandwidth * inertia
    of_effort = (abs(pull) - config.freedrive.resistance[joint]) / stiffness
    of_length = min(_stretch(state, joint) - _longest(config, bandwidth, joint), abs(pull) / stiffness)
    return -math.copysign(max(of_effort, of_length, 0.0), pull)


@inlined
def _longest(config: ControllerConfig, bandwidth: float, joint: int) -> float:
    """Length at which the spring of a joint yields, rad."""
    return _RECOIL * config.freedrive.velocity[joint] / bandwidth


@inlined
def _damp(config: ControllerConfig, state: ControllerState, bandwidth: float, eased: float) -> None:
    """Write the effort of the dampers to ``state.scratch[3]``.

    `eased` is the share of the dampers that acts.
    """
    motion, efforts, y = state.motion, state.scratch, state.signals
    for j in range(y.shape[1]):
        motion[0, j] = _velocity(state, j)
        motion[1, j] = _given_way(config, state, bandwidth, j)
        efforts[5, j] = 0.0
    inverse_dynamics(config.model, y[Signal.POSITION], efforts[5], motion[:2], efforts[3:5])
    add_offset(config, efforts[3:5], 1.0)
    own = followed = 0.0  # Twice the kinetic energy q' H q', and q' H u.
    for j in range(y.shape[1]):
        own += motion[0, j] * (efforts[3, j] - efforts[0, j])
        followed += motion[0, j] * (efforts[4, j] - efforts[0, j])
    share = 1.0 if followed <= own else max(own, 0.0) / followed
    for j in range(y.shape[1]):
        relative = efforts[3, j] - efforts[0, j] - share * (efforts[4, j] - efforts[0, j])
        efforts[3, j] = -_DAMPING * eased * bandwidth * relative


@inlined
def _possible(config: ControllerConfig, state: ControllerState) -> float:
    """Share of springs and dampers that the effort limits allow.

    It is the same for all joints: each limited alone, what brakes a heavy joint could accelerate a light one.
    """
    efforts, share = state.scratch, 1.0
    for j in range(efforts.shape[1]):
        carries, brakes = efforts[0, j] + state.hold[Hold.LEARNT, j], efforts[1, j] + efforts[3, j]
        left = max(config.limits.effort[j] - math.copysign(1.0, brakes) * carries, 0.0)
        if abs(brakes) > left:
            share = min(share, left / abs(brakes))
    return share


@inlined
def _given_way(config: ControllerConfig, state: ControllerState, bandwidth: float, joint: int) -> float:
    """Velocity with which a joint yields to a push, rad/s: it is not damped, unless its anchor cannot follow."""
    velocity, pull = _velocity(state, joint), state.scratch[1, joint]
    if pull * velocity >= 0.0:
        return 0.0
    loose = max(
        abs(pull) / config.freedrive.resistance[joint], _stretch(state, joint) / _longest(config, bandwidth, joint)
    )
    speed = min(loose, 1.0) * min(abs(velocity) / _CREEPS, 1.0) * abs(velocity)
    return math.copysign(min(_fastest(config, state, bandwidth, joint, velocity), speed), velocity)


@inlined
def _compensation(config: ControllerConfig, state: ControllerState, joint: int, pull: float) -> float:
    """Effort that compensates a part of the friction of a joint that slips, N m.

    It is less than what is left of the pull of the spring beside what was learnt, so that both together drive nothing.
    """
    effort = _COMPENSATED * friction(config, state.hold[Hold.SLIP, joint], joint)
    most = _COMPENSATED * max(abs(pull) - abs(state.hold[Hold.LEARNT, joint]), 0.0)
    return min(max(effort, -most), most) if effort * pull < 0.0 else 0.0


@inlined
def _fastest(config: ControllerConfig, state: ControllerState, bandwidth: float, joint: int, direction: float) -> float:
    """Largest velocity of an anchor in a direction, rad/s: less near the end of the range of the joint, then none."""
    low, high, q = (
        config.limits.min_position[joint],
        config.limits.max_position[joint],
        state.signals[Signal.POSITION, joint],
    )
    if low == high:
        return config.freedrive.velocity[joint]
    left = (high - q if direction > 0.0 else q - low) - min(_MARGIN * (high - low), _LARGEST_MARGIN)
    return min(max(_BRAKES * bandwidth * left, 0.0), config.freedrive.velocity[joint])


@part
def hand_over(state: ControllerState) -> None:
    """Apply the effort of freedrive once more; what it is beyond that of the law stays until the next approach."""
    efforts = state.signals[Signal.EFFORT]
    for j in range(efforts.size):
        beyond = state.sent[j] - efforts[j]
        state.freedrive_effort[j] = state.freedrive_before[j] = beyond
        efforts[j] = state.sent[j]
    state.times[Time.FREED] = 0


def refusal(config: ControllerConfig, state: ControllerState, joints: Sequence[str]) -> str:
    """Why freedrive could not hold the arm where it is now; empty if it can.

    Args:
        config: configuration of a law that uses the model.
        state: state; the measured position and the period of the joint states are read.
        joints: names of the joints.
    """
    weight, still = np.zeros((1, state.measured.size)), np.zeros(state.measured.size)
    inverse_dynamics(config.model, state.measured, still, still[np.newaxis], weight)
    for joint, effort, limit in zip(joints, np.abs(weight[0]), config.limits.effort, strict=True):
        if not effort <= _CARRIED * limit:
            return (
                f"{joint} needs {100.0 * effort / limit:.0f} % of limits.effort to carry the weight of the arm, which "
                f"is more than {100.0 * _CARRIED:.0f} %; move the arm to where it weighs less, or raise limits.effort"
            )
    needed, falls = np.zeros_like(still), np.zeros_like(still)
    for q in _postures(state.measured):
        forward_dynamics(config.model, q, still, still, falls)
        needed = np.maximum(
            needed, np.nan_to_num(_WRONG * np.abs(falls) / (_RECOIL * config.freedrive.velocity), nan=np.inf)
        )
    joint, cure = joints[int(needed.argmax())], "if the model lacks the inertia of its rotor, set robot.armature"
    if needed.max() > _BANDWIDTH:
        return f"{joint} is too light for freedrive, by the model; {cure}"
    if needed.max() > _bandwidth(state):
        rate, least = 1.0 / seconds(state.times[Time.PERIOD]), needed.max() / _OF_RATE
        return (
            f"{joint} is so light, by the model, that freedrive needs {least:.0f} joint states per second, and there "
            f"are {rate:.0f}; {cure}"
        )
    return ""


def _postures(q: Array) -> Iterator[Array]:
    """The position q, shape (joints,), rad, and those in which one joint is elsewhere."""
    yield q
    for j in range(q.size):
        for offset in (-_NEAR, _NEAR):
            other = q.copy()
            other[j] += offset
            yield other
