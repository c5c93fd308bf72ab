"""Integral sliding mode.

Utkin and Shi, "Integral sliding mode in systems operating under uncertainty conditions", Conference on Decision and
Control 1996.

The arm is to move as computed torque moves an arm that is as described:

    s = e' - e'(0) + int (Kp e + Kd e') dt,   q'' = q_d'' - Kp e - Kd e' - rho s / max(|s|, width)

From the first sample on s is 0, so there is no reaching phase: s measures what disturbances have changed. |s| is the
length of the vector of all joints, each relative to its width; so the arm is pushed straight back, and inside the layer
the term is linear.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.laws.base import ArmSample, Demand
from pidtsm_core.laws.of_arm import arm_law
from pidtsm_core.parameters import Parameter

# Memory: for each joint the integral of Kp e + Kd e' minus e'(0), its rate, e'(0); then 1 after the first sample.
_INTEGRAL, _RATE, _FIRST, _OF_JOINT = 0, 1, 2, 3


@njit
def command(arm: ArmSample, p: Array, x: Array, demand: Array) -> None:
    """See `ArmKernel.command`."""
    joints = p.shape[0]
    began = x[_OF_JOINT * joints] != 0.0
    square = 0.0
    for j in range(joints):
        own = _OF_JOINT * j
        e, de = arm.motion[0, j] - arm.desired[0, j], arm.motion[1, j] - arm.desired[1, j]
        nominal = p[j, 0] * e + p[j, 1] * de
        x[own + _RATE] = nominal
        if not began:
            x[own + _FIRST] = de
        s = de - x[own + _FIRST] + x[own + _INTEGRAL]
        square += (s / p[j, 3]) ** 2
        demand[Demand.SLIDING_VARIABLE, j] = demand[Demand.MANIFOLD_VARIABLE, j] = s
        demand[Demand.EQUIVALENT_ACCELERATION, j] = arm.desired[2, j] - nominal
    x[_OF_JOINT * joints] = 1.0
    length = max(math.sqrt(square), 1.0)
    for j in range(joints):
        switching = -p[j, 2] * demand[Demand.SLIDING_VARIABLE, j] / (p[j, 3] * length)
        demand[Demand.SWITCHING_TERM, j] = switching
        demand[Demand.ADAPTIVE_GAIN, j] = p[j, 2]
        demand[Demand.ACCELERATION, j] = demand[Demand.EQUIVALENT_ACCELERATION, j] + switching


@njit
def advance(p: Array, x: Array, frozen: Array, dt: float, adaptation: int) -> None:
    """See `ArmKernel.advance`; explicit Euler."""
    for j in range(p.shape[0]):
        if frozen[j] == 0.0:
            x[_OF_JOINT * j + _INTEGRAL] += dt * x[_OF_JOINT * j + _RATE]


INTEGRAL_SLIDING_MODE = arm_law(
    "integral_sliding_mode",
    "computed torque that disturbances do not change: a unit vector of all joints (Utkin and Shi 1996)",
    (
        Parameter("kp", 100.0, "gain of the error", "1/s^2", minimum=0.0, per_joint=True),
        Parameter("kd", 20.0, "gain of the velocity error", "1/s", minimum=0.0, per_joint=True),
        Parameter("gain", 10.0, "switching gain rho", "rad/s^2", minimum=0.0, per_joint=True),
        Parameter("width", 0.2, "boundary layer of s", "rad/s", minimum=0.0, exclusive=True, per_joint=True),
    ),
    command,
    advance,
    lambda joints: _OF_JOINT * joints + 1,
)
