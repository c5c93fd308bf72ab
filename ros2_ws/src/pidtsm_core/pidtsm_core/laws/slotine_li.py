"""Adaptive control of Slotine and Li.

"On the adaptive control of robot manipulators", International Journal of Robotics Research 6(3), 1987; Slotine and Li,
Applied Nonlinear Control, 1991, section 9.2.

With the reference velocity v = q_d' - lambda e and s = q' - v,

    effort = H v' + C v + G + Y theta - K s,   theta' = -Gamma Y' s

H, C and G are those of the model; theta is by how much the arm differs from it: mass, first moments and inertias of
each link (10), viscous and Coulomb friction of each joint. Y is their regressor. With the arm's own theta,

    V = (s' H s + (theta - theta*)' Gamma^-1 (theta - theta*)) / 2,   V' = -s' K s

so s and e vanish, whatever the parameters are; these converge only if the motion excites them.

K = R H R with R = diag(sqrt(rate)), so that a gain is a rate, and suits every arm. Gamma is relative to the inertia J
of the joint in the first posture: an error of the moments acts as an integral of s with the gain ``adaptation`` J.

C must be the matrix of Christoffel's symbols. It is not computed: c(a, b) = C(q, a) b is bilinear and symmetric, so

    4 c(a, b) = h(a + b) - h(a - b),   h(v) = C(q, v) v
"""

import math
from enum import IntEnum

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined, njit
from pidtsm_core.laws.base import ArmSample, Demand
from pidtsm_core.laws.of_arm import arm_law
from pidtsm_core.parameters import Parameter
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.robots.tree.layout import GRAVITY, ROW, SPACE, Column, Scratch, place_of, row_of, scratch, size
from pidtsm_core.robots.tree.newton_euler import inverse_dynamics as tree_efforts
from pidtsm_core.robots.tree.unit_forces import LINK, load_unit
from pidtsm_core.signals import Adaptation

_EARTH = 9.81
"""m/s^2; what a moment of mass is multiplied by."""
_REVERSAL = 0.01
"""rad/s; below this desired velocity, Coulomb friction goes to zero."""
_FRICTION = 2
"""Parameters of a joint: viscous, Coulomb."""
_SLOPE, _RATE, _ADAPTATION, _ZONE, _LEAKAGE, _LENGTH = 0, 1, 2, 3, 4, 5
_SPATIAL = 6


class _Row(IntEnum):
    """Scratch of `command`, per joint."""

    NONE = 0  # zeros
    S = 1
    SUM = 2  # of two velocities
    DIFFERENCE = 3
    WANTED = 4  # v'
    STILL = 5  # zeros: with PUSHED two accelerations
    PUSHED = 6  # R s
    EFFORT = 7
    SECOND = 8  # effort of the second of two accelerations


class _Flag(IntEnum):
    """Numbers at the end of the memory."""

    MOVES = 0  # above 0: an |s| is beyond its dead zone
    BEGAN = 1  # 1 after the first sample


_ROWS = len(_Row)


def _memory(joints: int) -> int:
    """See `_parts`."""
    return size(joints) + joints * (LINK + 2 * _FRICTION + 1 + _SPATIAL + _ROWS) + ROW + len(_Flag)


@inlined
def _parts(x: Array, joints: int) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array]:
    """What the memory consists of.

    The tree with theta; the gradient, of the links, then viscous, then Coulomb; friction; inertias that the joints
    move; velocities of the links under s; `_Row`; unit parameters; `_Flag`.
    """
    a = GRAVITY + joints * (ROW + SPACE)
    b = a + joints * (LINK + _FRICTION)
    c = b + joints * _FRICTION
    d = c + joints
    e = d + joints * _SPATIAL
    f = e + joints * _ROWS
    g = f + ROW
    return x[:a], x[a:b], x[b:c], x[c:d], x[d:e], x[e:f].reshape((_ROWS, joints)), x[f:g], x[g:]


@inlined
def _begin(arm: ArmSample, x: Array, joints: int) -> None:
    """The arm's geometry without masses, and the inertia that each joint moves."""
    tree, _, _, inertias, _, rows, _, _ = _parts(x, joints)
    for k in range(tree.size):
        tree[k] = arm.tree[k]
    for i in range(joints):
        for m in range(Column.MASS, ROW):
            tree[row_of(i) + m] = 0.0
    accelerations, efforts = rows[_Row.STILL : _Row.EFFORT], rows[_Row.EFFORT :]
    for j in range(joints):
        for k in range(joints):
            rows[_Row.NONE, k] = accelerations[0, k] = 0.0
            accelerations[1, k] = 1.0 if k == j else 0.0
        inverse_dynamics(arm.model, arm.motion[0], rows[_Row.NONE], accelerations, efforts)
        inertias[j] = efforts[1, j] - efforts[0, j]


@inlined
def _collect(tree: Array, joints: int, weight: float, velocities: Array, unit: Array, gradient: Array) -> None:
    """Add Y' s of the links for the motion in the tree's scratch: the power of unit forces at the velocities of s."""
    y = tree[scratch(joints) :]
    for i in range(joints):
        for parameter in range(LINK):
            load_unit(unit, y, i, parameter)
            power = 0.0
            for m in range(_SPATIAL):
                power += velocities[_SPATIAL * i + m] * y[i * SPACE + Scratch.MIXED + m]
            gradient[LINK * i + parameter] += weight * power


@njit
def command(arm: ArmSample, p: Array, x: Array, demand: Array) -> None:
    """See `ArmKernel.command`."""
    joints = p.shape[0]
    tree, gradient, friction, _, velocities, rows, unit, flags = _parts(x, joints)
    if flags[_Flag.BEGAN] == 0.0:
        _begin(arm, x, joints)
        flags[_Flag.BEGAN] = 1.0
    q, dq = arm.motion[0], arm.motion[1]
    none, s, total, difference = rows[_Row.NONE], rows[_Row.S], rows[_Row.SUM], rows[_Row.DIFFERENCE]
    wanted, pushed = rows[_Row.WANTED : _Row.STILL], rows[_Row.STILL : _Row.EFFORT]
    efforts, effort = rows[_Row.EFFORT :], rows[_Row.EFFORT : _Row.SECOND]
    moves = 0.0
    for j in range(joints):
        e, de = q[j] - arm.desired[0, j], dq[j] - arm.desired[1, j]
        s[j] = de + p[j, _SLOPE] * e
        none[j] = pushed[0, j] = 0.0
        wanted[0, j] = arm.desired[2, j] - p[j, _SLOPE] * de
        pushed[1, j] = math.sqrt(p[j, _RATE]) * s[j]
        moves = max(moves, abs(s[j]) - p[j, _ZONE])
        demand[Demand.SLIDING_VARIABLE, j] = demand[Demand.MANIFOLD_VARIABLE, j] = s[j]
        demand[Demand.EQUIVALENT_ACCELERATION, j] = demand[Demand.ACCELERATION, j] = wanted[0, j]
    flags[_Flag.MOVES] = moves
    # The model: of C v = C q' - C s, the robot model computes the former.
    inverse_dynamics(arm.model, q, none, pushed, efforts)
    for j in range(joints):
        demand[Demand.EFFORT, j] = -math.sqrt(p[j, _RATE]) * (efforts[1, j] - efforts[0, j])
        total[j], difference[j] = dq[j] + s[j], dq[j] - s[j]
    _add_product(arm, total, difference, -0.25, rows, demand)
    # What the arm has beyond the model.
    for k in range(gradient.size):
        gradient[k] = 0.0
    for j in range(joints):
        total[j] = 2.0 * dq[j] - s[j]
    tree_efforts(q, s, pushed[:1], tree, effort)
    y = tree[scratch(joints) :]
    for i in range(joints):
        for m in range(_SPATIAL):
            velocities[_SPATIAL * i + m] = y[i * SPACE + Scratch.VELOCITY + m]
    _take(tree, effort, -0.25, velocities, unit, gradient, demand)
    tree_efforts(q, total, pushed[:1], tree, effort)
    _take(tree, effort, 0.25, velocities, unit, gradient, demand)
    tree_efforts(q, none, wanted, tree, effort)
    _take(tree, effort, 1.0, velocities, unit, gradient, demand)
    for j in range(joints):
        sign = math.tanh(arm.desired[1, j] / _REVERSAL)
        gradient[LINK * joints + j] = arm.desired[1, j] * s[j]
        gradient[(LINK + 1) * joints + j] = sign * s[j]
        demand[Demand.EQUIVALENT_EFFORT, j] += friction[j] * arm.desired[1, j] + friction[joints + j] * sign
        demand[Demand.EFFORT, j] += demand[Demand.EQUIVALENT_EFFORT, j]


@inlined
def _add_product(arm: ArmSample, first: Array, second: Array, weight: float, rows: Array, demand: Array) -> None:
    """Add weight (h(first) - h(second)) of the model, see the module, to the equivalent effort."""
    q, still, effort = arm.motion[0], rows[_Row.STILL : _Row.PUSHED], rows[_Row.EFFORT : _Row.SECOND]
    inverse_dynamics(arm.model, q, first, still, effort)
    for j in range(q.size):
        demand[Demand.EQUIVALENT_EFFORT, j] += weight * effort[0, j]
    inverse_dynamics(arm.model, q, second, still, effort)
    for j in range(q.size):
        demand[Demand.EQUIVALENT_EFFORT, j] -= weight * effort[0, j]


@inlined
def _take(
    tree: Array, effort: Array, weight: float, velocities: Array, unit: Array, gradient: Array, demand: Array
) -> None:
    """Add what one motion contributes to Y theta and to Y' s."""
    joints = effort.shape[1]
    for j in range(joints):
        demand[Demand.EQUIVALENT_EFFORT, j] += weight * effort[0, j]
    _collect(tree, joints, weight, velocities, unit, gradient)


@njit
def advance(p: Array, x: Array, frozen: Array, dt: float, adaptation: int) -> None:
    """See `ArmKernel.advance`; explicit Euler. What one joint cannot follow would be blamed on all."""
    joints = p.shape[0]
    for j in range(joints):
        if frozen[j] != 0.0:
            return
    tree, gradient, friction, inertias, _, _, _, flags = _parts(x, joints)
    if flags[_Flag.BEGAN] == 0.0 or flags[_Flag.MOVES] <= 0.0 or adaptation == Adaptation.FROZEN:
        return
    for i in range(joints):
        j = place_of(tree, i)
        length, kept = p[j, _LENGTH], 1.0 - p[j, _LEAKAGE] * dt
        gain = p[j, _ADAPTATION] * inertias[j]
        of_moment = gain / (_EARTH * _EARTH)
        for k in range(LINK):
            place = row_of(i) + Column.MASS + k
            power = 0 if 1 <= k <= 3 else (-2 if k == 0 else 2)
            change = of_moment * length**power * gradient[LINK * i + k]
            tree[place] = kept * tree[place] - dt * change
        for k in range(_FRICTION):
            place = k * joints + j
            friction[place] = kept * friction[place] - dt * gain * gradient[LINK * joints + place]


SLOTINE_LI = arm_law(
    "slotine_li",
    "adaptive control that learns masses, inertias and friction of the arm (Slotine and Li 1987)",
    (
        Parameter("slope", 10.0, "lambda: e decays at this rate where s is 0", "1/s", minimum=0.0, per_joint=True),
        Parameter("rate", 10.0, "s decays at this rate if nothing is unknown", "1/s", minimum=0.0, per_joint=True),
        Parameter(
            "adaptation", 25.0, "gain of the adaptation, as an integral of s", "1/s^2", minimum=0.0, per_joint=True
        ),
        Parameter("dead_zone", 0.0, "nothing is adapted while no |s| is larger", "rad/s", minimum=0.0, per_joint=True),
        Parameter("leakage", 0.0, "what was learnt is forgotten at this rate", "1/s", minimum=0.0),
        Parameter(
            "length", 1.0, "of the arm: makes masses, moments and inertias comparable", "m", minimum=0.0, exclusive=True
        ),
    ),
    command,
    advance,
    _memory,
    needs_tree=True,
)
