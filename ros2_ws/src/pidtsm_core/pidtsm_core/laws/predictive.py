"""Model predictive control of the arm as it is in this posture.

Maciejowski, Predictive Control with Constraints, 2002; for robots: Poignet and Gautier, "Nonlinear model predictive
control of a robot manipulator", Advanced Motion Control 2000.

Under inverse dynamics the error of a joint obeys e'' = v. At each sample, v of five blocks of `step` minimises

    int (w^4 e^2 + 2 w^2 e'^2 + v^2) dt + what the infinite time behind them costs (Riccati)

such that the effort H(q) (q_d'' + v - d) + C q' + G of each block keeps within its limits, with H, C and G as they are
now; d is the disturbance that the controller subtracts. The first block is commanded. Where no limit is reached, this
is linear: nearly two poles at w. Otherwise Hildreth's procedure solves the dual problem (Wang, Model Predictive Control
System Design and Implementation, 2009, section 2.4): so a joint brakes in time, and where the effort of one joint is
limited, the others make up for what it does to them.
"""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined, njit
from pidtsm_core.laws.base import ArmSample, Demand
from pidtsm_core.laws.of_arm import arm_law
from pidtsm_core.parameters import Parameter
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.robots.inertia import write_inertia

_BLOCKS = 5
_SWEEPS = 60
_CONVERGED = 1e-6
"""Change of an effort in a sweep, as a share of its limit, at which it ends."""
_BANDWIDTH, _STEP = 0, 1


def _memory(joints: int) -> int:
    """See `_parts`."""
    pairs = _BLOCKS * joints
    return 2 * joints * (joints + 1) + joints * joints + joints * _BLOCKS**2 + 4 * pairs + joints + pairs * pairs


@inlined
def _parts(x: Array, joints: int) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    """What the memory consists of, all scratch.

    Unit accelerations and their efforts; H; inverse Hessians; v, planned efforts, multipliers and gradient of each
    block and joint; efforts with v = 0; D.
    """
    pairs = _BLOCKS * joints
    a = joints * (joints + 1)
    b = 2 * a
    c = b + joints * joints
    d = c + joints * _BLOCKS * _BLOCKS
    e = d + 4 * pairs
    f = e + joints
    return (
        x[:a].reshape((joints + 1, joints)),
        x[a:b].reshape((joints + 1, joints)),
        x[b:c].reshape((joints, joints)),
        x[c:d].reshape((joints * _BLOCKS, _BLOCKS)),
        x[d:e].reshape((4 * _BLOCKS, joints)),
        x[e:f],
        x[f:].reshape((pairs, pairs)),
    )


@inlined
def _position(of: int, block: int, h: float) -> float:
    """e at the end of a block due to v = 1 in block `of`."""
    return h * h * (block - of + 0.5) if block >= of else 0.0


@inlined
def _velocity(of: int, block: int, h: float) -> float:
    """e' likewise."""
    return h if block >= of else 0.0


@inlined
def _write_cost(e: float, de: float, w: float, h: float, hessian: Array, gradient: Array, joint: int) -> None:
    """The cost of a joint is v' hessian v / 2 + v' gradient, shapes (blocks, blocks) and (blocks, joints)."""
    for m in range(_BLOCKS):
        gradient[m, joint] = 0.0
        for n in range(_BLOCKS):
            hessian[m, n] = h if m == n else 0.0
    for block in range(_BLOCKS):
        # The terminal cost is x' P x with the solution P of the Riccati equation.
        ends = block == _BLOCKS - 1
        q1, q12, q2 = (2.0 * w**3, w**2, 2.0 * w) if ends else (h * w**4, 0.0, 2.0 * h * w**2)
        free = e + (block + 1) * h * de
        for m in range(_BLOCKS):
            pm, vm = _position(m, block, h), _velocity(m, block, h)
            gradient[m, joint] += pm * (q1 * free + q12 * de) + vm * (q12 * free + q2 * de)
            for n in range(_BLOCKS):
                pn, vn = _position(n, block, h), _velocity(n, block, h)
                hessian[m, n] += q1 * pm * pn + q12 * (pm * vn + vm * pn) + q2 * vm * vn


@inlined
def _invert(a: Array) -> None:
    """Replace a positive definite matrix by its inverse (Gauss and Jordan), shape (blocks, blocks)."""
    for k in range(_BLOCKS):
        pivot = 1.0 / a[k, k]
        a[k, k] = 1.0
        for j in range(_BLOCKS):
            a[k, j] *= pivot
        for i in range(_BLOCKS):
            if i != k:
                factor = a[i, k]
                a[i, k] = 0.0
                for j in range(_BLOCKS):
                    a[i, j] -= factor * a[k, j]


@inlined
def _plan(inertia: Array, v: Array, efforts: Array, carried: Array) -> None:
    """Write the efforts of each block for v beyond the carried ones, shape (blocks, joints)."""
    for b in range(_BLOCKS):
        for i in range(carried.size):
            effort = carried[i]
            for j in range(carried.size):
                effort += inertia[i, j] * v[b, j]
            efforts[b, i] = effort


@inlined
def _exceeds(efforts: Array, limits: Array) -> bool:
    """Whether an effort of a block is beyond its limit."""
    for b in range(_BLOCKS):
        for i in range(limits.size):
            if abs(efforts[b, i]) > limits[i]:
                return True
    return False


@inlined
def _couple(inertia: Array, inverse: Array, dual: Array) -> None:
    """D = C A^-1 C': how an effort of one block changes with the multiplier of another."""
    joints = inertia.shape[0]
    for b in range(_BLOCKS):
        for c in range(_BLOCKS):
            for i in range(joints):
                for k in range(joints):
                    value = 0.0
                    for j in range(joints):
                        value += inertia[i, j] * inverse[_BLOCKS * j + b, c] * inertia[k, j]
                    dual[b * joints + i, c * joints + k] = value


@inlined
def _keep_limits(dual: Array, efforts: Array, multipliers: Array, limits: Array) -> None:
    """Hildreth's procedure: each multiplier in turn makes its effort keep its limit, and is 0 if it does anyway."""
    joints = limits.size
    for k in range(dual.shape[0]):
        multipliers[k // joints, k % joints] = 0.0
    for _ in range(_SWEEPS):
        largest = 0.0
        for k in range(dual.shape[0]):
            b, i = k // joints, k % joints
            own, limit = dual[k, k], limits[i]
            alone = efforts[b, i] + own * multipliers[b, i]
            beyond = alone - limit if alone > limit else (alone + limit if alone < -limit else 0.0)
            change = beyond / own - multipliers[b, i]
            if change != 0.0:
                multipliers[b, i] += change
                largest = max(largest, abs(change * own) / limit)
                for m in range(dual.shape[0]):
                    efforts[m // joints, m % joints] -= dual[m, k] * change
        if not largest > _CONVERGED:
            return


@njit
def command(arm: ArmSample, p: Array, x: Array, demand: Array) -> None:
    """See `ArmKernel.command`."""
    joints = p.shape[0]
    unit, efforts, inertia, inverse, rows, carried, dual = _parts(x, joints)
    v, planned, multipliers = rows[:_BLOCKS], rows[_BLOCKS : 2 * _BLOCKS], rows[2 * _BLOCKS : 3 * _BLOCKS]
    gradient = rows[3 * _BLOCKS :]
    write_inertia(arm.model, arm.motion[0], unit, efforts, inertia)
    for j in range(joints):
        unit[0, j] = arm.desired[2, j] - arm.rejected[j]
    inverse_dynamics(arm.model, arm.motion[0], arm.motion[1], unit[:1], efforts[:1])
    for j in range(joints):
        e, de = arm.motion[0, j] - arm.desired[0, j], arm.motion[1, j] - arm.desired[1, j]
        carried[j] = efforts[0, j]
        own = inverse[_BLOCKS * j : _BLOCKS * (j + 1)]
        _write_cost(e, de, p[j, _BANDWIDTH], p[j, _STEP], own, gradient, j)
        _invert(own)
        for b in range(_BLOCKS):
            v[b, j] = 0.0
            for c in range(_BLOCKS):
                v[b, j] -= own[b, c] * gradient[c, j]
        demand[Demand.EQUIVALENT_ACCELERATION, j] = arm.desired[2, j] + v[0, j]
    _plan(inertia, v, planned, carried)
    if _exceeds(planned, arm.limits):
        _couple(inertia, inverse, dual)
        _keep_limits(dual, planned, multipliers, arm.limits)
        for j in range(joints):
            for c in range(_BLOCKS):
                for i in range(joints):
                    v[0, j] -= inverse[_BLOCKS * j, c] * inertia[i, j] * multipliers[c, i]
    for j in range(joints):
        demand[Demand.ACCELERATION, j] = arm.desired[2, j] + v[0, j]


@njit
def advance(p: Array, x: Array, frozen: Array, dt: float, adaptation: int) -> None:
    """This law keeps nothing."""


PREDICTIVE = arm_law(
    "predictive",
    "model predictive control of the linearised arm that knows the effort limits (Maciejowski 2002)",
    (
        Parameter(
            "bandwidth",
            10.0,
            "poles of the errors while no limit is reached",
            "rad/s",
            minimum=0.0,
            exclusive=True,
            per_joint=True,
        ),
        Parameter("step", 0.02, "duration of a block; there are five", "s", minimum=1e-3, maximum=1.0),
    ),
    command,
    advance,
    _memory,
)
