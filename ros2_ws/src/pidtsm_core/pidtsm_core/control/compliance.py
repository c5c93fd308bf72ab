"""The reference yields to what acts on the arm from outside, as a mass on springs with dampers.

With the offset z of the joints from the reference, the inertia matrix H of the arm, the torque f from outside, and the
spring and null space of tool_spring.py (or a spring for each joint),

    m H z'' + D z' = f - f_usual - (torque of the springs at z)

and D damps every mode with the same ratio. It is integrated by the trapezoidal rule for each mode. The law then follows
the reference plus z, z', z'' as robustly as any other: friction and errors of the model do not soften or stiffen it.

f is what the observer finds, about 3 / bandwidth late. At a stiff wall, a late force makes an admittance unstable if
it feels lighter than the arm (m < 1): the law subtracts the same late f from its command, so f / (m H) - f / H is what
the arm feels of it. With m = 1 this vanishes, and the late f does nothing but let the reference follow; with m > 1 it
is a passive filter of the force on the bare arm, (s + w / m) / (s + w) with an observer of bandwidth w (Colgate and
Hogan, International Journal of Control 48(1), 1988, define passivity; Keemink, van der Kooij and Stienen, International
Journal of Robotics Research 37(11), 2018, show that inertia below that of the robot is not passive).
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.compliance_parameters import GAINS, Compliance
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.state import Condition, ControllerState, External, part
from pidtsm_core.laws.symmetric import diagonalise
from pidtsm_core.laws.tool_spring import (
    POSE,
    Spring,
    force_of,
    multiply_transposed,
    spring_of,
    write_factor,
    write_spring,
)
from pidtsm_core.robots.inertia import divide, divide_transposed
from pidtsm_core.signals import Mode, Status

_FADES_IN = 0.5
"""s; time constant with which gains change: a stiffness that steps in contact would make the torque step."""
_TARED_IN, _AVERAGED = 1.0, 0.1
"""s; in the first second what acts on the arm is taken for none, averaged over 0.1 s."""
_ENDLESS = 1e5
"""N or N m; a larger limit is none."""
_NOTHING = 1e-9
"""rad and rad/s; a smaller offset, to which nothing from outside is left, is none."""


@inlined
def yield_to_contact(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Advance the offset of the reference over dt (s); it is none while the arm does not follow its reference."""
    if not (config.compliance.active or _yields(state)):
        state.compliance.age[0] = 0.0
    elif state.status[Status.MODE] != Mode.FOLLOWING:
        _forget_offset(state)
    elif dt > 0.0:
        _advance(config, state, dt)


@inlined
def _yields(state: ControllerState) -> bool:
    return state.conditions[Condition.YIELDS] != 0


@part
def _forget_offset(state: ControllerState) -> None:
    state.conditions[Condition.YIELDS] = 0
    for i in range(3):
        for j in range(state.compliance.force.size):
            state.compliance.offset[i, j] = 0.0


@inlined
def forget_compliance(state: ControllerState) -> None:
    """The arm is followed afresh: nothing has yielded, and nothing is known of what acts on it."""
    _forget_offset(state)
    state.compliance.age[0] = 0.0
    for j in range(state.compliance.usual.size):
        state.compliance.usual[j] = 0.0


@part
def _advance(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    own = state.compliance
    share = min(dt / _FADES_IN, 1.0) if own.age[0] > 0.0 else 1.0
    left = _feel(config, state, dt)
    pushed = left > 0.0
    # The springs balance what the dead zone leaves of a force; near the zone, they only bring the arm back.
    limited = max(left, 1.0 - left)
    _move_gains(own, config.compliance.gains, share, limited)
    if not (pushed or _yields(state)):
        return
    n, offset, rest, here = own.force.size, own.offset, own.rates[0], own.rates[1]
    for j in range(n):
        here[j] = state.desired[0, j]
        rest[j] = here[j] - offset[0, j]
    spring = spring_of(own.spring, n)
    write_factor(spring, config.model, here)
    if config.compliance.of_tool:
        for k in range(config.compliance.tree.size):
            spring.tree[k] = config.compliance.tree[k]
        for k in range(POSE):
            spring.stiffness[k] = own.gains[GAINS.STIFFNESS + k]
            spring.limits[k] = limited * own.gains[GAINS.LIMIT + k]
        null_space = own.gains[GAINS.NULL_SPACE]
        write_spring(spring, config.compliance.row, config.compliance.point, rest, here, null_space)
    else:
        _write_joint_springs(own, spring, limited)
    for j in range(n):
        own.force[j] += spring.efforts[0, j] + spring.efforts[1, j]
    _integrate(own, spring, config.compliance.damping, config.compliance.inertia, dt)
    _settle(state, pushed)


@inlined
def _move_gains(own: Compliance, wanted: Array, share: float, limited: float) -> None:
    """Move the gains by a share towards the wanted ones; `limited` is the share of the limits that holds."""
    gains, n = own.gains, own.force.size
    error = spring_of(own.spring, n).error
    for k in range(wanted.size):
        joint = k - GAINS.JOINTS - n
        if GAINS.LIMIT <= k < GAINS.NULL_SPACE:
            force = gains[GAINS.STIFFNESS + k - GAINS.LIMIT] * error[k - GAINS.LIMIT]
            gains[k] = _moved_limit(gains[k], wanted[k], force / limited, share)
        elif joint >= 0:
            force = gains[GAINS.JOINTS + joint] * own.offset[0, joint]
            gains[k] = _moved_limit(gains[k], wanted[k], force / limited, share)
        else:
            gains[k] += share * (wanted[k] - gains[k])


@inlined
def _moved_limit(present: float, wanted: float, force: float, share: float) -> float:
    """The next limit on the way to the wanted one; 0: none. It grows in proportion to itself.

    If there was none, it begins at the force that acts.
    """
    if share >= 1.0:
        return wanted
    if wanted == 0.0:
        return present * (1.0 + share) if present < _ENDLESS else 0.0
    if present == 0.0:
        return max(abs(force), wanted)
    return present + share * min(wanted - present, present)


@inlined
def _feel(config: ControllerConfig, state: ControllerState, dt: float) -> float:
    """Write the torque from outside beyond what is usual and the dead zone; return the share that the zone leaves."""
    own, zone = state.compliance, config.compliance.dead_zone
    size = 0.0
    if config.compliance.active and own.age[0] < _TARED_IN:
        share = min(dt / _AVERAGED, 1.0) if own.age[0] > 0.0 else 1.0
        for j in range(zone.size):
            own.usual[j] += share * (state.external[External.NOW, j] - own.usual[j])
    own.age[0] = min(own.age[0] + dt, _TARED_IN) if config.compliance.active else 0.0
    any_zone = False
    for j in range(zone.size):
        own.force[j] = state.external[External.NOW, j] - own.usual[j]
        if zone[j] > 0.0:
            any_zone = True
            size += (own.force[j] / zone[j]) ** 2
    left = 1.0
    if own.age[0] < _TARED_IN or (any_zone and size <= 1.0):
        left = 0.0
    elif any_zone:
        left = 1.0 - 1.0 / math.sqrt(size)
    for j in range(zone.size):
        own.force[j] *= left
    return left


@inlined
def _write_joint_springs(own: Compliance, spring: Spring, limited: float) -> None:
    """As `write_spring`, for a spring on each joint; `limited` is the share of the limits that holds."""
    n, offset = own.force.size, own.offset[0]
    for i in range(n):
        stiffness, limit = own.gains[GAINS.JOINTS + i], limited * own.gains[GAINS.JOINTS + n + i]
        spring.efforts[0, i] = force_of(stiffness, -offset[i], limit)
        spring.efforts[1, i] = 0.0
        row = spring.metric[i]
        for j in range(n):
            row[j] = math.sqrt(stiffness) if i == j else 0.0
        divide(spring.lower, row)
    for i in range(n):
        for j in range(n):
            spring.elastic[i, j] = 0.0
            for k in range(n):
                spring.elastic[i, j] += spring.metric[k, i] * spring.metric[k, j]
    diagonalise(spring.elastic, spring.modes)


@inlined
def _integrate(own: Compliance, spring: Spring, ratio: float, inertia: float, dt: float) -> None:
    """Advance the offset under the force, by the trapezoidal rule for each mode."""
    n, offset, rates, modal, force = own.force.size, own.offset, own.rates[0], own.rates[1], own.force
    multiply_transposed(spring.lower, offset[1], rates)
    divide(spring.lower, force)
    for m in range(n):
        rate, push = 0.0, 0.0
        for j in range(n):
            rate += spring.modes[j, m] * rates[j]
            push += spring.modes[j, m] * force[j]
        square = max(spring.elastic[m, m], 0.0) / inertia
        damped, bent = ratio * math.sqrt(square) * dt, 0.25 * square * dt * dt
        modal[m] = (rate * (1.0 - damped - bent) + dt * push / inertia) / (1.0 + damped + bent)
    for i in range(n):
        rates[i] = 0.0
        for m in range(n):
            rates[i] += spring.modes[i, m] * modal[m]
    divide_transposed(spring.lower, rates)
    for j in range(n):
        offset[0, j] += 0.5 * dt * (offset[1, j] + rates[j])
        offset[2, j] = (rates[j] - offset[1, j]) / dt
        offset[1, j] = rates[j]


@inlined
def _settle(state: ControllerState, pushed: bool) -> None:
    """Note whether the reference has yielded; an offset that has decayed, or is not finite, is none."""
    size, finite, offset = 0.0, True, state.compliance.offset
    for i in range(3):
        for j in range(offset.shape[1]):
            finite = finite and math.isfinite(offset[i, j])
            size = max(size, abs(offset[i, j]) if i < 2 else 0.0)
    state.conditions[Condition.YIELDS] = 1
    if not finite or (not pushed and size < _NOTHING):
        _forget_offset(state)


@inlined
def add_offset_of(state: ControllerState, motion: Array) -> None:
    """Add what the reference has yielded to `motion`, shape (3, joints)."""
    if _yields(state):
        _add_offset(state, motion[0], 0)
        _add_offset(state, motion[1], 1)
        _add_offset(state, motion[2], 2)


@part
def _add_offset(state: ControllerState, motion: Array, derivative: int) -> None:
    for j in range(motion.size):
        motion[j] += state.compliance.offset[derivative, j]


@inlined
def yielding_rate(state: ControllerState, joint: int) -> float:
    """Velocity with which the reference of a joint yields, rad/s."""
    return state.compliance.offset[1, joint] if _yields(state) else 0.0
