"""Impedance control in tool space: the tool yields to a force as a spring with a damper does.

See tool_spring.py for the sources. With e = q_d - q and the pose error x of the tool between the desired and the
estimated joint positions,

    effort = H q_d'' + C q' + G + J' K x + L N L' e + D e',   D = 2 ratio L sqrt(A) L'

so the inertia stays that of the arm, and H e'' + D e' + (J' K J + L N L') e = -J' f for a force f on the tool: no force
is measured, and no motion of what is touched makes it unstable.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined, njit
from pidtsm_core.laws.base import ArmSample, Demand
from pidtsm_core.laws.of_arm import arm_law
from pidtsm_core.laws.tool_spring import POSE, Spring, apply, spring_of, spring_size, write_factor, write_spring
from pidtsm_core.parameters import Parameter

_ROTATIONAL, _DAMPING, _NULL_SPACE, _FORCE, _TORQUE = 3, 4, 5, 6, 7
"""Places of the gains; before them, the stiffness along x, y, z."""


@inlined
def _write_damping(spring: Spring, ratio: float) -> None:
    """Write 2 ratio sqrt(A) to the metric."""
    metric, modes, n = spring.metric, spring.modes, spring.lower.shape[0]
    for i in range(n):
        for j in range(n):
            metric[i, j] = 0.0
            for m in range(n):
                rate = 2.0 * ratio * math.sqrt(max(spring.elastic[m, m], 0.0))
                metric[i, j] += modes[i, m] * rate * modes[j, m]


@njit
def command(arm: ArmSample, p: Array, x: Array, demand: Array) -> None:
    """See `ArmKernel.command`."""
    n = p.shape[0]
    spring = spring_of(x, n)
    for k in range(arm.tree.size):
        spring.tree[k] = arm.tree[k]
    for k in range(POSE):
        spring.stiffness[k] = p[0, min(k, _ROTATIONAL)]
        spring.limits[k] = p[0, _FORCE] if k < _ROTATIONAL else p[0, _TORQUE]
    write_factor(spring, arm.model, arm.motion[0])
    write_spring(spring, arm.tool_row, arm.tool_point, arm.desired[0], arm.motion[0], p[0, _NULL_SPACE])
    for j in range(n):
        demand[Demand.EFFORT, j] = spring.efforts[0, j] + spring.efforts[1, j]
        spring.efforts[2, j] = arm.desired[1, j] - arm.motion[1, j]
    _write_damping(spring, p[0, _DAMPING])
    apply(spring, spring.metric, 1)
    for j in range(n):
        demand[Demand.EFFORT, j] += spring.efforts[1, j]
        demand[Demand.EQUIVALENT_EFFORT, j] = demand[Demand.EFFORT, j]
        demand[Demand.ACCELERATION, j] = demand[Demand.EQUIVALENT_ACCELERATION, j] = arm.desired[2, j]


@njit
def advance(p: Array, x: Array, frozen: Array, dt: float, adaptation: int) -> None:
    """Nothing is remembered, see `ArmKernel.advance`."""


IMPEDANCE = arm_law(
    "impedance",
    "the tool yields as a spring with a damper (Hogan 1985, Albu-Schaeffer et al. 2003); no integral",
    (
        *(
            Parameter(f"stiffness_{axis}", 1000.0, f"of the tool along {axis} of the base", "N/m", minimum=0.0)
            for axis in "xyz"
        ),
        Parameter("rotational_stiffness", 50.0, "of the tool about every axis", "N m/rad", minimum=0.0),
        Parameter("damping_ratio", 1.0, "of every mode of the arm; 1: critically damped", minimum=0.0),
        Parameter("null_space", 5.0, "frequency of what moves the arm and not its tool", "rad/s", minimum=0.0),
        Parameter("force_limit", 0.0, "of the spring along each axis; 0: no limit", "N", minimum=0.0),
        Parameter("torque_limit", 0.0, "of the spring about each axis; 0: no limit", "N m", minimum=0.0),
    ),
    command,
    advance,
    spring_size,
    needs_tree=True,
)
