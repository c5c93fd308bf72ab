"""Levant's robust exact differentiator of second order, by implicit Euler, which avoids chattering.

    y1' = y2 + k1 |f - y1|^(2/3) sign(f - y1)          k1 = 2    L^(1/3)
    y2' = y3 + k2 |f - y1|^(1/3) sign(f - y1)          k2 = 2.12 L^(2/3)
    y3' =      k3 sign(f - y1)                         k3 = 1.1  L

Assumption: |q'''| <= L. Then the estimated derivatives of a signal without noise are exact after a finite time. The
differentiator needs no robot model and no torque. L is the only parameter: the largest jerk to be followed, including
that of the start. Noise of size n causes errors of the order L^(1/3) n^(2/3) in q' and L^(2/3) n^(1/3) in q''. If L is
too small, the estimates lose the signal, so choose L rather too large.

At each sample, let z^3 = |f - y1| be the new error. z is the positive root of a cubic, or 0. If z is 0, the sign may be
any value in [-1, 1], and y2 and y3 are divided differences of the signal. These lag: y2 is the slope in the middle of
the last period, so q' is y2 + T y3 / 2 (Seeber). The period may vary: y2 belongs to the middles of the periods, y3 to
the points between these middles. So each integrator has its own period: the distance between its neighbours. A lost
sample is such a longer period.

Levant, "Higher-order sliding modes, differentiation and output-feedback control", International Journal of Control
76(9/10), 2003; gains: Levant and Livne, "Robust exact filtering differentiators", European Journal of Control, 2020;
implicit form and its outputs: Seeber, "Proper implicit discretization of arbitrary-order robust exact
differentiators", arXiv:2404.02770, 2024; comparison of forms: Mojallizadeh, Brogliato and Acary, "Discrete-time
differentiators: design and comparative analysis", hal-02960923, 2020.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.estimators.base import Estimator, Sample
from pidtsm_core.parameters import Parameter

# State x: y1, y2, y3, the last two periods (newest first), 1 after the first sample.

_ROUNDS = 60  # of Newton's method; each reduces the distance to the root by a third or more, soon quadratically


@njit
def _root(a: float, b: float, c: float, free: float) -> float:
    """The positive root z of z^3 + a z^2 + b z + c = free, for a, b, c >= 0 and free > c.

    Newton's method starts above the root, where the cubic is convex and increasing, so it never passes the root.
    """
    z = (free - c) ** (1.0 / 3.0)
    for _ in range(_ROUNDS):
        step = (((z + a) * z + b) * z + (c - free)) / ((3.0 * z + 2.0 * a) * z + b)
        if not step > 1e-15 * z:
            break
        z -= step
    return z


@njit
def estimate(sample: Sample, p: Array, x: Array, estimates: Array) -> None:
    """The estimates start at rest: q' and q'' are 0 at the first sample."""
    q, dt = sample.q, sample.dt
    for j in range(q.size):
        if x[j, 5] == 1.0 and dt > 0.0:
            last = x[j, 3] if x[j, 3] > 0.0 else dt
            before = x[j, 4] if x[j, 4] > 0.0 else last
            between_slopes = 0.5 * (dt + last)
            between_curvatures = (dt + last + before) / 3.0
            root_l = p[j, 0] ** (1.0 / 3.0)
            # Gains of Levant and Livne (2020).
            k1, k2, k3 = 2.0 * root_l, 2.12 * root_l * root_l, 1.1 * p[j, 0]

            free = q[j] - x[j, 0] - dt * (x[j, 1] + between_slopes * x[j, 2])
            jump = dt * between_slopes * between_curvatures * k3
            if abs(free) <= jump:
                z, sign = 0.0, free / jump
            else:
                z, sign = _root(dt * k1, dt * between_slopes * k2, jump, abs(free)), math.copysign(1.0, free)
            x[j, 2] += between_curvatures * k3 * sign
            x[j, 1] += between_slopes * (x[j, 2] + k2 * z * sign)
            x[j, 0] += dt * (x[j, 1] + k1 * z * z * sign)
            x[j, 4] = last
            x[j, 3] = dt
            estimates[1, j] = x[j, 1] + 0.5 * dt * x[j, 2]
            estimates[2, j] = x[j, 2]
        elif x[j, 5] != 1.0:
            x[j, 0] = q[j]
            x[j, 5] = 1.0
            estimates[1, j] = estimates[2, j] = 0.0
        estimates[0, j] = x[j, 0]


ROBUST_DIFFERENTIATOR = Estimator(
    name="robust_differentiator",
    summary="Levant's robust exact differentiator of second order, implicit Euler",
    parameters=(Parameter("jerk", 100.0, "bound L of |q'''|", "rad/s^3", minimum=0.0, exclusive=True, per_joint=True),),
    estimate=estimate,
)
