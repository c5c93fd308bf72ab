"""How far the efforts of a tree can be from those of one state while the state is within a box around it.

The recursion is that of Newton and Euler, with the largest change of each vector instead of the vector. A rotation by
at most r about an axis moves a vector by at most r times its part across the axis, and a product changes by at most
|a| db + |b| da + da db. Nothing is left out, products of changes neither, so the result is a bound and no estimate.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined, subroutine
from pidtsm_core.robots.tree.layout import GRAVITY, ROW, SPACE, Column, Scratch, axis_of, parent_of, place_of, scratch

# Where the scratch of a link has the changes of its angular velocity, its angular and linear acceleration, and of the
# torque and the force on it. `inverse_dynamics` leaves this place unused.
_TURN, _TWIST, _PUSH, _TORQUE, _FORCE = range(int(Scratch.ANGULAR), int(Scratch.ANGULAR) + 5)


@inlined
def _norm(y: Array, k: int) -> float:
    return math.sqrt(y[k] * y[k] + y[k + 1] * y[k + 1] + y[k + 2] * y[k + 2])


@inlined
def _across(y: Array, k: int) -> float:
    """Length of the part across z."""
    return math.sqrt(y[k] * y[k] + y[k + 1] * y[k + 1])


@inlined
def _of_product(a: float, da: float, b: float, db: float) -> float:
    """Largest change of a product."""
    return a * db + b * da + da * db


@inlined
def _inertia_norm(p: Array, r: int) -> float:
    """An upper bound of what the rotational inertia makes of a unit vector: the Frobenius norm."""
    total = 0.0
    for m in range(6):
        value = p[r + Column.INERTIA + m]
        total += (1.0 if m < 3 else 2.0) * value * value
    return math.sqrt(total)


@inlined
def _move(p: Array, y: Array, i: int, rate: float, box: tuple[float, float, float]) -> None:
    """Changes of the motion of link i; `rate` is q' of its joint, `box` the largest changes of its q, q', q''."""
    k, parent, slides = i * SPACE, parent_of(p, i), axis_of(p, i) == 5
    v, a, t = k + Scratch.VELOCITY, k + Scratch.ACCELERATION, k + Scratch.TRANSLATION
    turn = twist = push = speed = twisting = 0.0
    if parent >= 0:
        turn, twist, push = y[parent * SPACE + _TURN], y[parent * SPACE + _TWIST], y[parent * SPACE + _PUSH]
        speed = _norm(y, parent * SPACE + Scratch.VELOCITY)
        twisting = _norm(y, parent * SPACE + Scratch.ACCELERATION)
    # Of the origin of the link, in the axes of its parent.
    shift, distance = box[0] if slides else 0.0, _norm(y, t)
    push += _of_product(twisting, twist, distance, shift)
    push += _of_product(speed * speed, turn * (2.0 * speed + turn), distance, shift)
    if slides:
        push += 2.0 * _of_product(speed, turn, abs(rate), box[1]) + box[2]
        y[k + _TURN], y[k + _TWIST], y[k + _PUSH] = turn, twist, push
        return
    # Into the axes of the link. The part of the velocity across z is the same on both sides of the joint.
    across = _across(y, v)
    turn += box[0] * across
    twist += box[0] * (_across(y, a) + across * abs(rate)) + _of_product(across, turn, abs(rate), box[1]) + box[2]
    # The acceleration of the origin: its spatial acceleration plus the product of both velocities.
    x = y[a + 3] + y[v + 1] * y[v + 5] - y[v + 2] * y[v + 4]
    x_ = y[a + 4] + y[v + 2] * y[v + 3] - y[v] * y[v + 5]
    push += box[0] * math.sqrt(x * x + x_ * x_)
    y[k + _TURN], y[k + _TWIST], y[k + _PUSH] = turn + box[1], twist, push


@inlined
def _load(p: Array, y: Array, i: int) -> None:
    """Changes of the torque and the force that link i itself needs, about its origin."""
    r, k = GRAVITY + i * ROW, i * SPACE
    mass, moment, inertia = p[r + Column.MASS], _norm(p, r + Column.MOMENT), _inertia_norm(p, r)
    speed, turn = _norm(y, k + Scratch.VELOCITY), y[k + _TURN]
    squared = turn * (2.0 * speed + turn)
    y[k + _FORCE] = mass * y[k + _PUSH] + moment * (y[k + _TWIST] + squared)
    y[k + _TORQUE] = inertia * (y[k + _TWIST] + squared) + moment * y[k + _PUSH]


@subroutine
def effort_spread(q: Array, dq: Array, ddq: Array, box: Array, p: Array, spread: Array) -> None:  # noqa: ARG001
    """Largest changes of the efforts, shape (joints,), N m or N, within a box.

    Args:
        q: in the middle of the box, shape (joints,), rad or m; not used, as `p` has what follows from it.
        dq: q' there, likewise, rad/s or m/s.
        ddq: q'' there, likewise; not used either.
        box: largest changes of q, q' and q'', shape (3, joints), rad, rad/s, rad/s^2 or m, m/s, m/s^2.
        p: the tree, shape (size(joints),), whose scratch is that of `inverse_dynamics` in the middle of the box.
        spread: result in the first row, shape (3, joints).
    """
    joints = dq.size
    y = p[scratch(joints) :]
    for i in range(joints):
        j = place_of(p, i)
        _move(p, y, i, dq[j], (box[0, j], box[1, j], box[2, j]))
        _load(p, y, i)
    for i in range(joints - 1, -1, -1):
        k, j, parent, slides = i * SPACE, place_of(p, i), parent_of(p, i), axis_of(p, i) == 5
        f, distance = k + Scratch.FORCE, _norm(y, k + Scratch.TRANSLATION)
        armature = p[GRAVITY + i * ROW + Column.ARMATURE]
        spread[0, j] = y[k + (_FORCE if slides else _TORQUE)] + armature * box[2, j]
        if parent < 0:
            continue
        turned, shift = (0.0, box[0, j]) if slides else (box[0, j], 0.0)
        force = y[k + _FORCE] + turned * _across(y, f + 3)
        torque = y[k + _TORQUE] + turned * _across(y, f)
        y[parent * SPACE + _FORCE] += force
        y[parent * SPACE + _TORQUE] += torque + _of_product(distance, shift, _norm(y, f + 3), force)
