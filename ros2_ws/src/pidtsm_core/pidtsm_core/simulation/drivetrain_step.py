"""The motion of an arm with drive trains: motors, elastic gears, their friction, and the links.

With link positions q and motor positions p behind the gears (M. W. Spong, J. Dyn. Sys. Meas. Control 109, 1987)::

    M(q) q'' + c(q, q') = S + external torques,    S = K (p - q) + D (p' - q')
    B p'' = torque of the motor - S - friction

A step consists of equal substeps by the two-stage Gauss method, which is of fourth order, stable for any stiffness,
and keeps the energy of linear vibrations (Hairer, Norsett and Wanner II, 1996, section IV.5). M and c are those in the
middle of the step, so that a substep is linear but for friction. The complex eigenvalue of the method turns both stages
into one complex equation for the links (J. C. Butcher, BIT 16, 1976), from which the motors have been eliminated.

The friction of a motor sticks by a state, the deflection z of bristles (Dupont et al., IEEE Trans. Automat. Contr. 47,
2002, with their purely elastic range up to the breakaway): while z is below level / stiffness it is a spring, hence
nothing creeps; beyond, the joint slides at that level.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import PartOf
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.robots import Model, inverse_dynamics
from pidtsm_core.simulation.disturbances import add_disturbance
from pidtsm_core.simulation.drivetrain import Drivetrain, DrivetrainState, Kept, Middle, Rub, Term, example

_ROOT = math.sqrt(3.0)
_EIGENVALUE = complex(3.0, _ROOT)
"""Eigenvalue of the inverse of the coefficients of the method; the other one is its conjugate."""
_ONE = complex(1.0, _ROOT - 2.0)
"""A constant in both stages, in its complex form y1 - i (2 - sqrt 3) y2."""
_SECOND = 1.0 / (_ROOT - 2.0)
"""Second stage per imaginary part."""
BRAKING = 0.002
"""Time constant with which the brakes stop the motors, s."""
_FIRM = 1e12
"""Damping of the brakes of a rigid joint, N m s/rad."""
_ATTEMPTS = 6
"""Largest number of times that a substep decides which joints stick."""
_SHARPNESS = 10.0
"""See `friction.add_friction`."""
_SLOW = 1e-9
"""rad/s; below, the smooth curve of friction is a straight line."""

part = PartOf(lambda: example()[0], lambda: example()[1], lambda: example()[2])


@part
def move(
    config: Drivetrain, state: DrivetrainState, model: Model, q: Array, dq: Array, t: float, dt: float, braked: bool
) -> None:
    """Move motors and links from t to t + dt (s).

    Args:
        config: parameters.
        state: of the drive trains, modified.
        model: of the links, with their rotors.
        q: position of the links, shape (joints,), rad, modified.
        dq: their velocity, likewise, rad/s.
        t: time, s.
        dt: s.
        braked: whether the brakes stop the motors, which then have no torque.
    """
    middle, h = state.middle, dt / config.substeps
    _keep(state, q, dq)
    for j in range(q.size):
        middle[Middle.POSITION, j] = q[j] + 0.5 * dt * dq[j]
        middle[Middle.VELOCITY, j] = dq[j]
    for last in (False, True):
        _prepare(config, state, model, t + 0.5 * dt)
        for k in range(config.substeps):
            _substep(config, state, q, dq, t + k * h, h, braked)
        if not last:
            _look_back(state, q, dq, dt)


@inlined
def _keep(state: DrivetrainState, q: Array, dq: Array) -> None:
    """Copy the motion."""
    start = state.start
    for j in range(q.size):
        start[Kept.LINK, j] = q[j]
        start[Kept.LINK_VELOCITY, j] = dq[j]
        start[Kept.MOTOR, j] = state.motor[j]
        start[Kept.MOTOR_VELOCITY, j] = state.motor_velocity[j]
        start[Kept.BRISTLE, j] = state.bristle[j]
        start[Kept.SLIDING, j] = state.sliding[j]
        start[Kept.TRANSMITTED, j] = state.transmitted[j]


@inlined
def _look_back(state: DrivetrainState, q: Array, dq: Array, dt: float) -> None:
    """Put the motion back to the start of the step, after its middle has been read from its ends."""
    start, middle = state.start, state.middle
    for j in range(q.size):
        q0, dq0 = start[Kept.LINK, j], start[Kept.LINK_VELOCITY, j]
        middle[Middle.POSITION, j] = 0.5 * (q0 + q[j]) - 0.125 * dt * (dq[j] - dq0)
        middle[Middle.VELOCITY, j] = 1.5 * (q[j] - q0) / dt - 0.25 * (dq0 + dq[j])
        q[j], dq[j] = q0, dq0
        state.motor[j] = start[Kept.MOTOR, j]
        state.motor_velocity[j] = start[Kept.MOTOR_VELOCITY, j]
        state.bristle[j] = start[Kept.BRISTLE, j]
        state.sliding[j] = start[Kept.SLIDING, j]
        state.transmitted[j] = start[Kept.TRANSMITTED, j]


@inlined
def _prepare(config: Drivetrain, state: DrivetrainState, model: Model, t: float) -> None:
    """Compute M, and the external torques minus c, in the middle of the step, which is at t (s)."""
    middle, efforts, net = state.middle, state.efforts, state.middle[Middle.NET]
    inverse_dynamics(model, middle[Middle.POSITION], middle[Middle.VELOCITY], state.rows, efforts)
    for i in range(net.size):
        net[i] = state.external[i]
        for j in range(i + 1):
            state.inertia[i, j] = 0.5 * (efforts[1 + i, j] - efforts[0, j] + efforts[1 + j, i] - efforts[0, i])
        state.inertia[i, i] -= config.rotor[i]
    add_disturbance(config.disturbance, t, middle[Middle.POSITION], middle[Middle.VELOCITY], net)
    for i in range(net.size):
        net[i] -= efforts[0, i]


@inlined
def _substep(config: Drivetrain, state: DrivetrainState, q: Array, dq: Array, t: float, h: float, braked: bool) -> None:
    """One step of the method, of length h (s), from t (s)."""
    joints, terms = q.size, state.terms
    for j in range(joints):
        rub(config, state, j, t, h)
    for _ in range(_ATTEMPTS):
        for j in range(joints):
            _eliminate(config, state, j, q[j], dq[j], h, braked)
            for i in range(j):
                state.matrix[j, i] = _EIGENVALUE / h * state.inertia[j, i]
        _solve(state)
        if braked or not _change_sides(config, state, dq, h):
            break
    for j in range(joints):
        x = terms[Term.CHANGE, j]
        v1, v2 = dq[j] + x.real, dq[j] + x.imag * _SECOND
        carried = terms[Term.CARRIED, j] - terms[Term.IMPEDANCE, j] * x
        state.transmitted[j] = 0.5 * (carried.real + carried.imag * _SECOND)
        _follow(config, state, j, dq[j] * _ONE + x, h, braked)
        q[j] += 0.5 * h * (v1 + v2)
        dq[j] += _ROOT * (v2 - v1)
        if config.stiffness[j] == 0.0:
            if braked:
                dq[j] = math.exp(-h / BRAKING) * state.motor_velocity[j]
            elif config.friction.stiffness[j] > 0.0 and state.sliding[j] == 0.0:
                dq[j] = 0.5 * (v1 + v2)
            state.motor[j], state.motor_velocity[j] = q[j], dq[j]


@inlined
def rub(config: Drivetrain, state: DrivetrainState, j: int, t: float, h: float) -> None:
    """Write of the friction of a joint: its level, the torque without it, and what is proportional to velocity."""
    friction, rubbing = config.friction, state.friction
    p, speed = state.motor[j], state.motor_velocity[j]
    ratio = speed / friction.stribeck_velocity[j]
    level = friction.coulomb[j] + friction.excess[j] * math.exp(-ratio * ratio)
    if friction.load[j] > 0.0:
        level += friction.load[j] * abs(state.transmitted[j])
    warmth = 1.0
    if friction.cold[j] > 0.0:
        warmth += friction.cold[j] * math.exp(-t / friction.warm_up[j])
    rubbing[Rub.LEVEL, j] = level * warmth
    rubbing[Rub.DRY, j] = friction.offset[j]
    if friction.cogging[j] > 0.0:
        rubbing[Rub.DRY, j] += friction.cogging[j] * math.sin(friction.periods[j] * (p + 0.5 * h * speed))
    rubbing[Rub.DRAG, j] = friction.viscous[j] * warmth
    if friction.stiffness[j] == 0.0:
        level = level_of(config, state, j, speed)
        rate = _SHARPNESS / friction.stribeck_velocity[j]
        slow = abs(speed) < _SLOW
        rubbing[Rub.DRAG, j] += level * (rate if slow else math.tanh(rate * speed) / speed)


@inlined
def level_of(config: Drivetrain, state: DrivetrainState, j: int, direction: float) -> float:
    """Dry friction of a joint that moves in the direction of a number, N m."""
    share = config.friction.asymmetry[j]
    return state.friction[Rub.LEVEL, j] * (1.0 + share if direction > 0.0 else 1.0 - share)


@inlined
def _divided(value: complex, by: complex) -> complex:
    """A quotient; nan by 0, to which absurd parameters may round, so that the arm counts as diverged."""
    return value / by if by != 0.0 else complex(math.nan, math.nan)


@inlined
def _eliminate(config: Drivetrain, state: DrivetrainState, j: int, q: float, dq: float, h: float, braked: bool) -> None:
    """Write the equation of link j, from which its motor has been eliminated.

    See `Term`.
    """
    terms, friction, torque = state.terms, config.friction, state.torque[j]
    drag, dry = complex(state.friction[Rub.DRAG, j], 0.0), state.friction[Rub.DRY, j]
    if friction.stiffness[j] > 0.0:
        if state.sliding[j] == 0.0:
            drag += friction.stiffness[j] * h / _EIGENVALUE + friction.damping[j]
            dry += friction.stiffness[j] * state.bristle[j]
        else:
            dry += state.sliding[j] * level_of(config, state, j, state.sliding[j])
    stopping = state.motor_velocity[j] * BRAKING * (1.0 - math.exp(-h / BRAKING)) / h
    stiffness = config.stiffness[j]
    if stiffness > 0.0:
        spring = stiffness * h / _EIGENVALUE + config.damping[j]
        inertia, held = _EIGENVALUE * config.rotor[j] / h, stiffness * (state.motor[j] - q)
        whole = inertia + drag + spring
        if braked:
            terms[Term.FREE, j], terms[Term.FOLLOWS, j] = stopping * _ONE, 0.0
        else:
            pushed = (inertia * state.motor_velocity[j] + (torque - dry - held)) * _ONE
            terms[Term.FREE, j] = _divided(pushed, whole)
            terms[Term.FOLLOWS, j] = _divided(spring, whole)
        terms[Term.IMPEDANCE, j] = spring * (1.0 - terms[Term.FOLLOWS, j])
        terms[Term.CARRIED, j] = held * _ONE + spring * terms[Term.FREE, j] - terms[Term.IMPEDANCE, j] * dq * _ONE
    else:
        terms[Term.FREE, j], terms[Term.FOLLOWS, j] = 0.0, 1.0
        terms[Term.IMPEDANCE, j] = _FIRM if braked else drag
        terms[Term.CARRIED, j] = (_FIRM * (stopping - dq) if braked else torque - dry - drag * dq) * _ONE
    terms[Term.CHANGE, j] = terms[Term.CARRIED, j] + state.middle[Middle.NET, j] * _ONE
    state.matrix[j, j] = _EIGENVALUE / h * state.inertia[j, j] + terms[Term.IMPEDANCE, j]


@inlined
def _solve(state: DrivetrainState) -> None:
    """Solve for `Term.CHANGE`, by L D L' of the symmetric matrix, which is overwritten."""
    a, x = state.matrix, state.terms[Term.CHANGE]
    joints = x.size
    for i in range(joints):
        pivot = a[i, i]
        for k in range(i):
            entry = a[i, k]
            for m in range(k):
                entry -= a[i, m] * a[k, m]
            a[i, k] = entry
        for k in range(i):
            entry = a[i, k]
            a[i, k] = entry * a[k, k]
            pivot -= entry * a[i, k]
            x[i] -= a[i, k] * x[k]
        a[i, i] = _divided(complex(1.0, 0.0), pivot)
    for i in range(joints - 1, -1, -1):
        x[i] *= a[i, i]
        for k in range(i + 1, joints):
            x[i] -= a[k, i] * x[k]


@inlined
def _mean_speed(state: DrivetrainState, j: int, links: complex) -> float:
    """Mean velocity of motor j in a substep in which its link has these velocities, rad/s."""
    motor = state.terms[Term.FREE, j] + state.terms[Term.FOLLOWS, j] * links
    return 0.5 * (motor.real + motor.imag * _SECOND)


@inlined
def _change_sides(config: Drivetrain, state: DrivetrainState, dq: Array, h: float) -> bool:
    """Let joints slide that cannot stick, and the other way round; return whether there are any."""
    changed, friction = False, config.friction
    for j in range(dq.size):
        if friction.stiffness[j] > 0.0:
            speed = _mean_speed(state, j, dq[j] * _ONE + state.terms[Term.CHANGE, j])
            if state.sliding[j] == 0.0:
                held = friction.stiffness[j] * (state.bristle[j] + h * speed)
                if abs(held) > level_of(config, state, j, held):
                    state.sliding[j] = math.copysign(1.0, held)
                    changed = True
            elif state.sliding[j] * speed < 0.0:
                state.sliding[j] = 0.0
                changed = True
    return changed


@inlined
def _follow(config: Drivetrain, state: DrivetrainState, j: int, links: complex, h: float, braked: bool) -> None:
    """Move motor j and its bristles."""
    stiffness = config.friction.stiffness[j]
    motor = state.terms[Term.FREE, j] + state.terms[Term.FOLLOWS, j] * links
    w1, w2 = motor.real, motor.imag * _SECOND
    speed = 0.5 * (w1 + w2)
    if config.stiffness[j] > 0.0:
        state.motor[j] += h * speed
        state.motor_velocity[j] = (
            math.exp(-h / BRAKING) * state.motor_velocity[j] if braked else state.motor_velocity[j] + _ROOT * (w2 - w1)
        )
    if stiffness > 0.0 and not braked:
        if state.sliding[j] != 0.0:
            state.bristle[j] = state.sliding[j] * level_of(config, state, j, state.sliding[j]) / stiffness
        else:
            state.bristle[j] += h * speed
            if config.stiffness[j] > 0.0:
                state.motor_velocity[j] = speed
