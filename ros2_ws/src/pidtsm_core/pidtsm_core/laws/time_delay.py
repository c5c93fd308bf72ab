"""Time-delay control with a nonsingular terminal sliding mode, the article's reference [19].

Jin, Lee, Chang and Choi, "Practical nonsingular terminal sliding-mode control of robot manipulators for high-accuracy
tracking control", IEEE Transactions on Industrial Electronics 56(9), 2009.

No model of the arm is needed: with a constant inertia M of each joint, all else that acts was seen at the last sample,

    effort = M u + N,   N(t) = effort(t - dt) - M q''(t - dt)
    s = e + |e'|^(p/q) sign(e') / beta
    u = q_d'' - beta / (p/q) |e'|^(2 - p/q) sign(e') - k1 s - k2 |s|^rho sign(s)

It is stable if no eigenvalue of 1 - H^-1 M is outside the unit circle (Hsia and Gao 1990), so M may be too small, but
not twice too large. N begins with the effort that carries the arm by its
model, and is low-pass filtered, because the acceleration is noisy; a slow filter acts as a small M does.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.laws.base import ArmSample, Demand
from pidtsm_core.laws.filtered import Filtered, advance, memory, rows
from pidtsm_core.laws.of_arm import arm_law, signed_power
from pidtsm_core.parameters import Parameter


@njit
def command(arm: ArmSample, p: Array, x: Array, demand: Array) -> None:
    """See `ArmKernel.command`; effort and acceleration are what `filtered` keeps."""
    joints = p.shape[0]
    own, _ = rows(arm, x, joints)
    for j in range(joints):
        inertia, k1, k2, beta, power, rho, cutoff = p[j, 0], p[j, 1], p[j, 2], p[j, 3], p[j, 4], p[j, 5], p[j, 6]
        e, de = arm.motion[0, j] - arm.desired[0, j], arm.motion[1, j] - arm.desired[1, j]
        forget = math.exp(-cutoff * arm.dt)
        own[Filtered.FIRST, j] = forget * own[Filtered.FIRST_BEFORE, j] + (1.0 - forget) * arm.effort[j]
        own[Filtered.SECOND, j] = forget * own[Filtered.SECOND_BEFORE, j] + (1.0 - forget) * arm.motion[2, j]
        other = own[Filtered.FIRST, j] - inertia * own[Filtered.SECOND, j]
        s = e + signed_power(de, power) / beta
        equivalent = arm.desired[2, j] - beta / power * signed_power(de, 2.0 - power)
        reaching = -k1 * s - k2 * signed_power(s, rho)
        demand[Demand.EQUIVALENT_ACCELERATION, j] = inertia * equivalent + other
        demand[Demand.ACCELERATION, j] = inertia * (equivalent + reaching) + other
        demand[Demand.SLIDING_VARIABLE, j] = demand[Demand.MANIFOLD_VARIABLE, j] = s
        demand[Demand.SWITCHING_TERM, j] = reaching


TIME_DELAY = arm_law(
    "time_delay",
    "time-delay control with nonsingular terminal sliding mode, without a model (Jin et al. 2009, reference [19])",
    (
        Parameter(
            "inertia", 1.0, "constant inertia M of the joint", "kg m^2", minimum=0.0, exclusive=True, per_joint=True
        ),
        Parameter("k1", 200.0, "gain of s", "1/s^2", minimum=0.0, per_joint=True),
        Parameter("k2", 10.0, "gain of |s|^rho", minimum=0.0, per_joint=True),
        Parameter("beta", 10.0, "gain of e in the surface", minimum=0.0, exclusive=True, per_joint=True),
        Parameter("p_over_q", 1.2, "exponent of e' in the surface", minimum=1.0, maximum=1.99, per_joint=True),
        Parameter("rho", 0.7, "exponent of s in the reaching law", minimum=0.1, maximum=1.0, per_joint=True),
        Parameter("cutoff", 500.0, "cutoff of the filter of N", "rad/s", minimum=0.0, exclusive=True, per_joint=True),
    ),
    command,
    advance,
    memory,
    uses_model=False,
)
