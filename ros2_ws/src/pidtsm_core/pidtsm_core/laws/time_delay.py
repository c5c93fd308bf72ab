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
from pidtsm_core.laws.of_arm import arm_law, carry_arm, signed_power
from pidtsm_core.parameters import Parameter

# Memory: filtered effort and acceleration at the last sample, and at this one, of each joint; scratch; then 1 after the
# first sample.
_BEFORE, _WAS, _NOW, _IS, _SCRATCH, _ROWS = 0, 1, 2, 3, 4, 5


@njit
def command(arm: ArmSample, p: Array, x: Array, demand: Array) -> None:
    """See `ArmKernel.command`."""
    joints = p.shape[0]
    own = x[: _ROWS * joints].reshape((_ROWS, joints))
    if x[_ROWS * joints] == 0.0:
        carry_arm(arm, own[_SCRATCH:], own[_BEFORE:_WAS])
    for j in range(joints):
        inertia, k1, k2, beta, power, rho, cutoff = p[j, 0], p[j, 1], p[j, 2], p[j, 3], p[j, 4], p[j, 5], p[j, 6]
        e, de = arm.motion[0, j] - arm.desired[0, j], arm.motion[1, j] - arm.desired[1, j]
        forget = math.exp(-cutoff * arm.dt)
        own[_NOW, j] = forget * own[_BEFORE, j] + (1.0 - forget) * arm.effort[j]
        own[_IS, j] = forget * own[_WAS, j] + (1.0 - forget) * arm.motion[2, j]
        other = own[_NOW, j] - inertia * own[_IS, j]
        s = e + signed_power(de, power) / beta
        equivalent = arm.desired[2, j] - beta / power * signed_power(de, 2.0 - power)
        reaching = -k1 * s - k2 * signed_power(s, rho)
        demand[Demand.EQUIVALENT_ACCELERATION, j] = inertia * equivalent + other
        demand[Demand.ACCELERATION, j] = inertia * (equivalent + reaching) + other
        demand[Demand.SLIDING_VARIABLE, j] = demand[Demand.MANIFOLD_VARIABLE, j] = s
        demand[Demand.SWITCHING_TERM, j] = reaching


@njit
def advance(p: Array, x: Array, frozen: Array, dt: float, adaptation: int) -> None:
    """See `ArmKernel.advance`. N follows the effort that was applied, so it cannot wind up."""
    joints = p.shape[0]
    for k in range(_NOW * joints):
        x[k] = x[_NOW * joints + k]
    x[_ROWS * joints] = 1.0


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
    lambda joints: _ROWS * joints + 1,
    uses_model=False,
)
