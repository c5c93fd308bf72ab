"""Linear-quadratic and H-infinity control, with gains for each posture.

Zhou and Doyle, Essentials of Robust Control, 1998, chapters 12 and 14; with an integral: Anderson and Moore, Optimal
Control, 1990, section 2.3.

With effort = H(q) q_d'' + C q' + G + u, the errors obey H(q) e'' = u + d. In each posture u minimises

    int (qi |int e|^2 + q1 |e|^2 + q2 |e'|^2 + |u|^2) dt,

in the measures |e|^2 = sum J_j e_j^2 and |u|^2 = sum u_j^2 / J_j, where J_j is the diagonal of H(q). In them, a
rotation decouples the joints (it diagonalises H_ij / sqrt(J_i J_j)), and for each eigenvalue l the Riccati equation is
a spectral factorisation, which has one unknown:

    (l x^3 + a x^2 + b x + c)(-l x^3 + a x^2 - b x + c) = -l^2 x^6 + q2 x^4 - q1 x^2 + qi

The weights are such that a joint alone has three poles at ``bandwidth``. H-infinity control bounds the energy of the
errors and of u to ``attenuation``^2 times that of the worst d: its gains are those for all weights times
B = 1 - 1/attenuation^2, divided by B.
"""

import math
from enum import IntEnum

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined, njit
from pidtsm_core.laws.base import ArmSample, Demand
from pidtsm_core.laws.of_arm import arm_law
from pidtsm_core.laws.symmetric import diagonalise
from pidtsm_core.parameters import Parameter
from pidtsm_core.robots.inertia import write_inertia

_ITERATIONS = 60
_CONVERGED = 1e-14
_BANDWIDTH, _INTEGRAL, _POSITION, _VELOCITY, _ATTENUATION = 0, 1, 2, 3, 4


class _Row(IntEnum):
    """What is kept of a joint, or of a mode."""

    INTEGRAL = 0  # of e
    ERROR = 1  # e
    ROOT = 2  # sqrt(J)
    MODE = 3  # scratch: what the mode demands


_ROWS = len(_Row)


def _memory(joints: int) -> int:
    """See `_parts`."""
    return joints * (_ROWS + 2 * (joints + 1) + 2 * joints)


@inlined
def _parts(x: Array, joints: int) -> tuple[Array, Array, Array, Array, Array]:
    """Rows of `_Row`; scratch: unit accelerations and their efforts, inertia matrix and rotation."""
    a = joints * _ROWS
    b = a + joints * (joints + 1)
    c = b + joints * (joints + 1)
    d = c + joints * joints
    return (
        x[:a].reshape((_ROWS, joints)),
        x[a:b].reshape((joints + 1, joints)),
        x[b:c].reshape((joints + 1, joints)),
        x[c:d].reshape((joints, joints)),
        x[d:].reshape((joints, joints)),
    )


@inlined
def factorise(inertia: float, qi: float, q1: float, q2: float) -> tuple[float, float, float]:
    """a, b, c of the spectral factor, see the module, by Newton's method from above, where the polynomial is convex."""
    c = math.sqrt(qi)
    a = math.sqrt(q2) + (16.0 * inertia**2 * c) ** (1.0 / 3.0) + (8.0 * inertia**2 * q1) ** 0.25
    b = 0.0
    for _ in range(_ITERATIONS):
        b = 0.5 * (a * a - q2) / inertia
        slope = 2.0 * b * a / inertia - 2.0 * c
        step = (b * b - 2.0 * a * c - q1) / slope if slope > 0.0 else 0.0
        a -= step
        if not abs(step) > _CONVERGED * a:
            break
    return a, 0.5 * (a * a - q2) / inertia, c


@njit
def command(arm: ArmSample, p: Array, x: Array, demand: Array) -> None:
    """See `ArmKernel.command`."""
    joints = p.shape[0]
    own, unit, efforts, inertia, rotation = _parts(x, joints)
    write_inertia(arm.model, arm.motion[0], unit, efforts, inertia)
    for j in range(joints):
        own[_Row.ERROR, j] = arm.motion[0, j] - arm.desired[0, j]
        own[_Row.ROOT, j] = math.sqrt(inertia[j, j])
    for i in range(joints):
        for j in range(joints):
            inertia[i, j] /= own[_Row.ROOT, i] * own[_Row.ROOT, j]
    diagonalise(inertia, rotation)
    w, bound = p[0, _BANDWIDTH], 1.0 - 1.0 / p[0, _ATTENUATION] ** 2
    qi = bound * p[0, _INTEGRAL] * w**6
    q1, q2 = bound * 3.0 * p[0, _POSITION] * w**4, bound * 3.0 * p[0, _VELOCITY] * w**2
    for m in range(joints):
        a, b, c = factorise(max(inertia[m, m], 1e-9), qi, q1, q2)
        mode = 0.0
        for j in range(joints):
            de = arm.motion[1, j] - arm.desired[1, j]
            wanted = c * own[_Row.INTEGRAL, j] + b * own[_Row.ERROR, j] + a * de
            mode += rotation[j, m] * own[_Row.ROOT, j] * wanted
        own[_Row.MODE, m] = mode / bound
    for j in range(joints):
        effort = 0.0
        for m in range(joints):
            effort -= own[_Row.ROOT, j] * rotation[j, m] * own[_Row.MODE, m]
        demand[Demand.EFFORT, j] = demand[Demand.EQUIVALENT_EFFORT, j] = effort
        demand[Demand.ACCELERATION, j] = demand[Demand.EQUIVALENT_ACCELERATION, j] = arm.desired[2, j]


@njit
def advance(p: Array, x: Array, frozen: Array, dt: float, adaptation: int) -> None:
    """See `ArmKernel.advance`; explicit Euler."""
    joints = p.shape[0]
    for j in range(joints):
        if frozen[j] == 0.0:
            x[_Row.INTEGRAL * joints + j] += dt * x[_Row.ERROR * joints + j]


_WEIGHTS = tuple(
    Parameter(f"{name}_weight", 1.0, f"weight of {what}, relative to that for three poles", minimum=0.0)
    for name, what in (("integral", "int e"), ("position", "e"), ("velocity", "e'"))
)

LINEAR_QUADRATIC = arm_law(
    "linear_quadratic",
    "inverse dynamics with linear-quadratic or H-infinity gains for each posture (Zhou and Doyle 1998)",
    (
        Parameter("bandwidth", 10.0, "three poles of a joint", "rad/s", minimum=0.0, exclusive=True),
        *_WEIGHTS,
        Parameter(
            "attenuation",
            3.0,
            "gamma: bound of the H-infinity norm; the larger, the closer to linear-quadratic control",
            minimum=1.01,
        ),
    ),
    command,
    advance,
    _memory,
)
