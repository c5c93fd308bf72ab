"""Observer of an arm with elastic joints: encoders at the motors, from which springs lead to the links.

Of each joint, a rotor (J, diagonal) moves its link through a spring k with a damper c. The weighted mean of motors and
links, p = H^-1 (J motor + (H - J) link), moves as the rigid arm does, whatever the springs do; beside it, the twists
t = motor - link swing. With the disturbance d as in `extended_state`, in which friction of the motors is the most:

    H p'' = effort - C p' - G + H d,   d' = 0
    (J - J H^-1 J) t'' = effort + H d - k t - c t' - J p''
    motor = p + t - H^-1 J t,   link = p - H^-1 J t

An observer that takes the arm for rigid finds a motor that moves up to H / J times as easily as it believes, and must
be slow. This one knows it, and sees the friction of a motor in the motor's own quick motion. What it reports is the
motion of the links. Joints without rotor or stiffness are rigid. Stiffness, rotors and inertias may be a fifth wrong.

From sample to sample, the states follow the model under the held effort, the twists by the trapezoidal rule, which is
stable with any stiffness. Then the measurement corrects each joint, with the gains of a Kalman filter for that joint
alone in the middle of the range (`elastic_gains`), for the nominal rate; after a shorter time, with a share of them.

Elastic joints: M. W. Spong, J. Dyn. Sys. Meas. Control 109, 1987.
"""

import math
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined, njit
from pidtsm_core.estimators.base import DISTURBANCE, Estimator, Sample
from pidtsm_core.estimators.elastic_gains import kalman_gains
from pidtsm_core.parameters import Parameter
from pidtsm_core.parameters.family import SLOTS
from pidtsm_core.robots import forward_dynamics
from pidtsm_core.robots.inertia import divide, divide_transposed, factorise, write_inertia

_PARAMETERS = (
    Parameter(
        "bandwidth",
        30.0,
        "speed of the observer; five times the rate at most",
        "rad/s",
        minimum=0.0,
        exclusive=True,
        per_joint=True,
    ),
    Parameter(
        "stiffness",
        0.0,
        "of the gear between motor and link; 0: the joint is rigid, as is one without robot.armature",
        "N m/rad",
        minimum=0.0,
        per_joint=True,
    ),
    Parameter("damping", 0.0, "of the gear between motor and link", "N m s/rad", minimum=0.0, per_joint=True),
    Parameter("rate", 1000.0, "joint states per second for which its gains are", "Hz", minimum=1.0),
    Parameter("at_links", False, "the encoders measure the links, not the motors"),
)
# Parameters of a joint, as `estimate` reads them: s, whether the encoder measures the link, kg m^2 (0: the joint is
# rigid), N m/rad, N m s/rad, and the corrections of p, p', d, the twist and its rate.
_PERIOD, _AT_LINK, _ROTOR, _STIFFNESS, _DAMPING, _TO_P, _TO_DP, _TO_D, _TO_TWIST, _TO_RATE = range(10)
# State of a joint beside p, p' and d: 1 after the first sample, rad, rad/s.
_KNOWN, _TWIST, _RATE = 3, 4, 5

_POLES = 1.5
"""Its Butterworth pattern delays the disturbance by 2 / bandwidth; so do three real poles at 1.5 times that."""
_ABSURD = 1e9  # rad, rad/s or rad/s^2; far above the values of any arm, far below overflow
_STEP = 5e-4  # s; longest step of the prediction between two samples
_SILENCE = 1.0  # s; after a longer gap between samples the motion of the arm is unknown


def _prepare(packed: Array, rotor: Array, inertia: Array) -> Array:
    """See `Estimator.prepare`.

    A joint for whose spring there are no gains in numbers, as with a damper that no gear has, counts as rigid.
    """
    bandwidth, stiffness, damping, rates, at_links = packed.T[: len(_PARAMETERS)]
    period, found = 1.0 / float(rates[0]), np.zeros((rotor.size, _TO_RATE + 1))
    found[:, _PERIOD], found[:, _AT_LINK] = period, at_links
    found[:, _STIFFNESS], found[:, _DAMPING] = stiffness, damping
    moved, on_links = np.where(stiffness > 0.0, rotor, 0.0), bool(at_links[0])
    gains = kalman_gains(moved, inertia, stiffness, damping, on_links, bandwidth, period)
    rigid = ~np.isfinite(gains).all(axis=1)
    if rigid.any():
        moved = np.where(rigid, 0.0, moved)
        gains = kalman_gains(moved, inertia, stiffness, damping, on_links, bandwidth, period)
    found[:, _ROTOR], found[:, _TO_P:] = moved, gains
    return found


class _Matrices(NamedTuple):
    """Scratch."""

    rows: Array  # shape (joints + 1, joints)
    efforts: Array  # likewise
    inertia: Array  # H, shape (joints, joints)
    factor: Array  # of H, likewise
    stiff: Array  # factor of what the twists' acceleration is divided by, likewise
    share: Array  # row j is column j of H^-1 J, likewise
    force: Array  # on the twists, N m; then what was measured beyond what was predicted, rad; shape (joints,)


def _rows(joints: int) -> int:
    """See `Estimator.rows`."""
    return math.ceil((2 * (joints + 1) * joints + 4 * joints * joints + joints) / SLOTS)


@inlined
def _matrices(x: Array, n: int) -> _Matrices:
    """The scratch behind the states of the joints."""
    own, a, b = x[n:].reshape(-1), (n + 1) * n, n * n
    square = own[2 * a : 2 * a + 4 * b].reshape((4, n, n))
    return _Matrices(
        own[:a].reshape((n + 1, n)),
        own[a : 2 * a].reshape((n + 1, n)),
        square[0],
        square[1],
        square[2],
        square[3],
        own[2 * a + 4 * b : 2 * a + 4 * b + n],
    )


@njit
def _write_matrices(sample: Sample, p: Array, q: Array, h: float, x: Array) -> None:
    """Write the matrices for the position q, and for steps of h (s)."""
    n = q.size
    m = _matrices(x, n)
    write_inertia(sample.model, q, m.rows, m.efforts, m.inertia)
    for i in range(n):
        for j in range(n):
            m.factor[i, j] = m.inertia[i, j]
    factorise(m.factor)
    for j in range(n):
        for i in range(n):
            m.share[j, i] = p[j, _ROTOR] if i == j else 0.0
        divide(m.factor, m.share[j])
        divide_transposed(m.factor, m.share[j])
    for i in range(n):
        for j in range(n):
            m.stiff[i, j] = -p[i, _ROTOR] * m.share[j, i]
        m.stiff[i, i] += p[i, _ROTOR] + 0.25 * h * h * p[i, _STIFFNESS] + 0.5 * h * p[i, _DAMPING]
        if p[i, _ROTOR] == 0.0:
            m.stiff[i, i] = 1.0
    factorise(m.stiff)


@njit
def _step(sample: Sample, p: Array, x: Array, h: float, estimates: Array) -> None:
    """Follow the model for h (s): p, p' in the first two rows of `estimates`, and the twists in x."""
    n, position, velocity, acceleration = sample.q.size, estimates[0], estimates[1], estimates[2]
    m = _matrices(x, n)
    forward_dynamics(sample.model, position, velocity, sample.effort, acceleration)
    for j in range(n):
        m.force[j] = 0.0
        ddq = acceleration[j] + x[j, DISTURBANCE]
        if p[j, _ROTOR] > 0.0:
            m.force[j] = sample.effort[j] - p[j, _ROTOR] * ddq - p[j, _DAMPING] * x[j, _RATE]
            m.force[j] -= p[j, _STIFFNESS] * (x[j, _TWIST] + 0.5 * h * x[j, _RATE])
            for k in range(n):
                m.force[j] += m.inertia[j, k] * x[k, DISTURBANCE]
        position[j] += h * (velocity[j] + 0.5 * h * ddq)
        velocity[j] += h * ddq
    divide(m.stiff, m.force)
    divide_transposed(m.stiff, m.force)
    for j in range(n):
        x[j, _TWIST] += h * (x[j, _RATE] + 0.5 * h * m.force[j])
        x[j, _RATE] += h * m.force[j]


@inlined
def _carried(m: _Matrices, x: Array, j: int, what: int) -> float:
    """How far joint j of the mean is ahead of its link because of the twists, or their rates: a row of H^-1 J t."""
    found = 0.0
    for k in range(m.share.shape[0]):
        found += m.share[k, j] * x[k, what]
    return found


@njit
def _correct(sample: Sample, p: Array, x: Array, estimates: Array) -> None:
    """Correct p, p', d and the twists for the measurement."""
    m, pace = _matrices(x, sample.q.size), sample.pace
    for j in range(sample.q.size):
        seen = estimates[0, j] - _carried(m, x, j, _TWIST)
        if p[j, _AT_LINK] == 0.0:
            seen += x[j, _TWIST]
        m.force[j] = pace * min(sample.dt / p[j, _PERIOD], 1.0) * (sample.q[j] - seen)
    for j in range(sample.q.size):
        estimates[0, j] += p[j, _TO_P] * m.force[j]
        estimates[1, j] += pace * p[j, _TO_DP] * m.force[j]
        x[j, DISTURBANCE] += pace * pace * p[j, _TO_D] * m.force[j]
        x[j, _TWIST] += p[j, _TO_TWIST] * m.force[j]
        x[j, _RATE] += p[j, _TO_RATE] * m.force[j]
        x[j, 0], x[j, 1] = estimates[0, j], estimates[1, j]


@njit
def estimate(sample: Sample, p: Array, x: Array, estimates: Array) -> None:
    """The estimates are those of the links, except for q'', which is the mean's, under the torque held before.

    The arm is assumed to be at rest, without a twist, at the first sample, after a gap of more than one second, and
    after an absurd measurement that makes the states diverge.
    """
    n, dt = sample.q.size, sample.dt
    known = x[0, _KNOWN] == 1.0 and 0.0 < dt <= _SILENCE
    if known:
        steps = math.ceil(dt / _STEP)
        for j in range(n):
            estimates[0, j], estimates[1, j] = x[j, 0], x[j, 1]
        _write_matrices(sample, p, estimates[0], dt / steps, x)
        for _ in range(steps):
            _step(sample, p, x, dt / steps, estimates)
        _correct(sample, p, x, estimates)
        forward_dynamics(sample.model, estimates[0], estimates[1], sample.effort, estimates[2])
        m = _matrices(x, n)
        for j in range(n):
            estimates[0, j] -= _carried(m, x, j, _TWIST)
            estimates[1, j] -= _carried(m, x, j, _RATE)
            estimates[2, j] += x[j, DISTURBANCE]
            for row in range(3):
                known = known and abs(estimates[row, j]) < _ABSURD
    if not known:
        for j in range(n):
            estimates[0, j] = x[j, 0] = sample.q[j]
            estimates[1, j] = estimates[2, j] = x[j, 1] = x[j, DISTURBANCE] = x[j, _TWIST] = x[j, _RATE] = 0.0
            x[j, _KNOWN] = 1.0


ELASTIC_JOINT_OBSERVER = Estimator(
    name="elastic_joint_observer",
    summary="q, q' and disturbance of links that motors move through springs, with the robot model",
    parameters=_PARAMETERS,
    estimate=estimate,
    finds_disturbance=True,
    # Not lateness: springs look like it.
    teaches=frozenset({"adaptation.friction", "adaptation.softening"}),
    poles=_POLES,
    prepare=_prepare,
    rows=_rows,
)
