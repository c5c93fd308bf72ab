"""The spring that ties a tool to a desired pose, and the modes in which an arm moves on it.

Hogan, "Impedance control", Journal of Dynamic Systems, Measurement, and Control 107(1), 1985; without a measured force:
Ott, Cartesian Impedance Control of Redundant and Flexible-Joint Robots, 2008, section 3.2; damping by double
diagonalisation: Albu-Schaeffer, Ott, Frese and Hirzinger, "Cartesian impedance control of redundant robots", ICRA 2003.

With the inertia matrix H = L L' of the arm, the Jacobian J and the stiffness K of the tool, the modes are eigenvectors
of A = L^-1 (J' K J) L^-T + N. The eigenvalues (rad^2/s^2) that are not 0 or of N are those of the tool on its spring,
H_x^-1 K with H_x = (J H^-1 J')^-1; but nothing is divided by, so there may be fewer than six joints, and singular
postures are harmless.

N is the dynamically consistent stiffness of the null space (Khatib 1987), frequency^2 B: B projects on the null space
of J L^-T, so N disturbs the tool neither at rest nor moving. An eigenvalue w of L^-1 J' J L^-T (1/kg) counts in B as
(c / (w + c))^2, which is 1 in the null space and is smooth near singular postures.

Axes are those of the base; the rotational part of a pose error is the rotation vector.
"""

import math
from typing import NamedTuple

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.symmetric import diagonalise
from pidtsm_core.robots import Model
from pidtsm_core.robots.inertia import divide, factorise, write_inertia
from pidtsm_core.robots.tree.kinematics import forward_kinematics
from pidtsm_core.robots.tree.layout import SPACE, Column, parent_of, place_of, row_of, size

POSE = 6
"""Numbers of a pose: position, then rotation vector."""
_PLACEMENT = 12
_IMMOBILE = 1e-3
"""c, 1/kg or 1/(kg m^2): the tool hardly moves in a direction in which its inertia is larger than 1/c. With 0.01, the
null space of a Panda that is nearly stretched stiffens its tool by a tenth."""
_OPPOSITE = 0.9 * math.pi
"""rad; beyond this angle the torque decreases to 0 at a half turn, where it must change its direction."""


class Spring(NamedTuple):
    """Scratch of `write_spring`, and its results."""

    tree: Array  # the arm without masses
    wanted: Array  # placements of its links where the tool should be, shape (joints, 3, 4)
    found: Array  # and where it is, likewise
    error: Array  # pose of the tool from where it is to where it should be, shape (POSE,), m and rad
    jacobian: Array  # of the tool, shape (POSE, joints), times L^-T
    stiffness: Array  # to be written before, shape (POSE,), N/m and N m/rad
    limits: Array  # likewise, of the force and torque along each axis, N and N m; 0: no limit
    lower: Array  # L, shape (joints, joints)
    null: Array  # N, likewise
    modes: Array  # in columns, likewise
    elastic: Array  # A; its diagonal has the eigenvalues, likewise
    metric: Array  # scratch, likewise
    efforts: Array  # of the spring, of the null space, and scratch, shape (3, joints), N m
    units: Array  # scratch, shape (2, joints + 1, joints)


def spring_size(joints: int) -> int:
    """How many numbers a spring needs."""
    matrices, units = 5 * joints * joints, 2 * (joints + 1) * joints
    return size(joints) + joints * (2 * _PLACEMENT + POSE + 3) + 3 * POSE + matrices + units


@inlined
def spring_of(x: Array, n: int) -> Spring:
    """The spring in the first `spring_size` numbers of x, of shape (size,), of an arm with n joints."""
    a = row_of(n) + n * SPACE
    b = a + 2 * _PLACEMENT * n
    c = b + POSE * n
    d = c + 3 * POSE
    e = d + 5 * n * n
    f = e + 3 * n
    placements = x[a:b].reshape((2, n, 3, 4))
    poses = x[c:d].reshape((3, POSE))
    matrices = x[d:e].reshape((5, n, n))
    return Spring(
        x[:a],
        placements[0],
        placements[1],
        poses[0],
        x[b:c].reshape((POSE, n)),
        poses[1],
        poses[2],
        matrices[0],
        matrices[1],
        matrices[2],
        matrices[3],
        matrices[4],
        x[e:f].reshape((3, n)),
        x[f : f + 2 * (n + 1) * n].reshape((2, n + 1, n)),
    )


@inlined
def _write_turn(wanted: Array, found: Array, error: Array) -> None:
    """Write the rotation vector (rad) from a rotation to the wanted one, in the axes of the base, to error[3:6].

    It fades beyond `_OPPOSITE`. The first three columns of both placements, shape (3, 4), are rotations.
    """
    cosine = -0.5
    for k in range(3):
        error[3 + k] = 0.0
        a, b = (k + 1) % 3, (k + 2) % 3
        for m in range(3):
            cosine += 0.5 * wanted[k, m] * found[k, m]
            error[3 + k] += 0.5 * (wanted[b, m] * found[a, m] - wanted[a, m] * found[b, m])
    sine = math.sqrt(error[3] ** 2 + error[4] ** 2 + error[5] ** 2)
    angle = math.atan2(sine, cosine)
    scale = 1.0
    if sine > 1e-9:
        scale = angle / sine * min(1.0, (math.pi - angle) / (math.pi - _OPPOSITE))
    for k in range(3):
        error[3 + k] *= scale


@inlined
def _write_jacobian(spring: Spring, row: int, here: tuple[float, float, float]) -> None:
    """Write the Jacobian of the tool, which the link `row` carries and whose origin is `here` (m)."""
    jacobian, found, i = spring.jacobian, spring.found, row
    while i >= 0:
        z0, z1, z2, j = found[i, 0, 2], found[i, 1, 2], found[i, 2, 2], place_of(spring.tree, i)
        if spring.tree[row_of(i) + Column.SLIDES] != 0.0:
            jacobian[0, j], jacobian[1, j], jacobian[2, j] = z0, z1, z2
        else:
            r0, r1, r2 = here[0] - found[i, 0, 3], here[1] - found[i, 1, 3], here[2] - found[i, 2, 3]
            jacobian[0, j], jacobian[1, j], jacobian[2, j] = z1 * r2 - z2 * r1, z2 * r0 - z0 * r2, z0 * r1 - z1 * r0
            jacobian[3, j], jacobian[4, j], jacobian[5, j] = z0, z1, z2
        i = parent_of(spring.tree, i)


@inlined
def _write_pose_error(spring: Spring, row: int, point: Array, q_d: Array, q: Array) -> None:
    """Write the pose error of the tool and its Jacobian."""
    error, jacobian, wanted, found = spring.error, spring.jacobian, spring.wanted, spring.found
    forward_kinematics(q_d, spring.tree, wanted)
    forward_kinematics(q, spring.tree, found)
    for k in range(POSE):
        error[k] = 0.0
        for j in range(jacobian.shape[1]):
            jacobian[k, j] = 0.0
    if row < 0:
        return
    here0, here1, here2 = found[row, 0, 3], found[row, 1, 3], found[row, 2, 3]
    for m in range(3):
        for k in range(3):
            error[k] += (wanted[row, k, m] - found[row, k, m]) * point[m]
        here0 += found[row, 0, m] * point[m]
        here1 += found[row, 1, m] * point[m]
        here2 += found[row, 2, m] * point[m]
    for k in range(3):
        error[k] += wanted[row, k, 3] - found[row, k, 3]
    _write_turn(wanted[row], found[row], error)
    _write_jacobian(spring, row, (here0, here1, here2))


@inlined
def multiply(lower: Array, column: Array, result: Array) -> None:
    """Write L times a column, shape (joints,)."""
    for j in range(result.size):
        result[j] = 0.0
        for i in range(j + 1):
            result[j] += lower[j, i] * column[i]


@inlined
def multiply_transposed(lower: Array, column: Array, result: Array) -> None:
    """Write L' times a column, shape (joints,)."""
    for i in range(result.size):
        result[i] = 0.0
        for j in range(i, result.size):
            result[i] += lower[j, i] * column[j]


@inlined
def _write_null_space(spring: Spring, square: float) -> None:
    """Write N, with the square of its frequency, from the Jacobian times L^-T."""
    jacobian, metric, modes, null = spring.jacobian, spring.metric, spring.modes, spring.null
    n = null.shape[0]
    for i in range(n):
        for j in range(n):
            metric[i, j] = null[i, j] = 0.0
            for k in range(POSE):
                metric[i, j] += jacobian[k, i] * jacobian[k, j]
    if square == 0.0:
        return
    diagonalise(metric, modes)
    for i in range(n):
        for j in range(n):
            for m in range(n):
                weight = _IMMOBILE / (max(metric[m, m], 0.0) + _IMMOBILE)
                null[i, j] += square * weight * weight * modes[i, m] * modes[j, m]


@inlined
def force_of(stiffness: float, error: float, limit: float) -> float:
    """Force (N) or torque (N m) of a spring within its limit; 0: no limit."""
    force = stiffness * error
    return min(max(force, -limit), limit) if limit > 0.0 else force


@inlined
def write_factor(spring: Spring, model: Model, q: Array) -> None:
    """Write L of the arm's inertia matrix at q, shape (joints,), rad."""
    write_inertia(model, q, spring.units[0], spring.units[1], spring.lower)
    factorise(spring.lower)


@inlined
def write_spring(spring: Spring, row: int, point: Array, q_d: Array, q: Array, null_space: float) -> None:
    """Write the efforts of the spring and of the null space, and the modes; `write_factor` comes before.

    Args:
        spring: with tree, stiffness and limits.
        row: of the link that carries the tool, see `robots.Tool`.
        point: the tool in that link, shape (3,), m.
        q_d: positions of the joints at which the spring is at rest, shape (joints,), rad.
        q: where they are, likewise.
        null_space: frequency, rad/s.
    """
    n, jacobian, efforts, elastic = q.size, spring.jacobian, spring.efforts, spring.elastic
    _write_pose_error(spring, row, point, q_d, q)
    for j in range(n):
        efforts[0, j] = 0.0
        for k in range(POSE):
            efforts[0, j] += jacobian[k, j] * force_of(spring.stiffness[k], spring.error[k], spring.limits[k])
    for k in range(POSE):
        divide(spring.lower, jacobian[k])
    _write_null_space(spring, null_space * null_space)
    for i in range(n):
        for j in range(n):
            elastic[i, j] = spring.null[i, j]
            for k in range(POSE):
                elastic[i, j] += jacobian[k, i] * spring.stiffness[k] * jacobian[k, j]
    diagonalise(elastic, spring.modes)
    for j in range(n):
        efforts[2, j] = q_d[j] - q[j]
    apply(spring, spring.null, 1)


@inlined
def apply(spring: Spring, matrix: Array, row: int) -> None:
    """Write L matrix L' times the last row of the efforts to another row; `matrix` has shape (joints, joints)."""
    n, left, right = spring.lower.shape[0], spring.units[0, 0], spring.units[0, 1]
    multiply_transposed(spring.lower, spring.efforts[2], left)
    for i in range(n):
        right[i] = 0.0
        for j in range(n):
            right[i] += matrix[i, j] * left[j]
    multiply(spring.lower, right, spring.efforts[row])
