"""PD with a disturbance observer, as drives of industrial arms have it.

Ohnishi, Shibata and Murakami, "Motion control for advanced mechatronics", IEEE/ASME Transactions on Mechatronics 1(1),
1996.

Each joint counts as a constant inertia J; gravity, coupling and friction are one disturbance d, observed through a
low-pass filter with cutoff g, from the velocity alone:

    d = g/(x + g) (effort + g J q') - g J q',   effort = J (q_d'' - Kd e' - Kp e) + d

Sampled, with f = exp(-g dt): d(k) = f d(k-1) + (1 - f) effort - f g J (q'(k) - q'(k-1)). It
begins with the effort that carries the arm by its model.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.laws.base import ArmSample, Demand
from pidtsm_core.laws.filtered import Filtered, advance, memory, rows
from pidtsm_core.laws.of_arm import arm_law
from pidtsm_core.parameters import Parameter


@njit
def command(arm: ArmSample, p: Array, x: Array, demand: Array) -> None:
    """See `ArmKernel.command`; d and q' are what `filtered` keeps."""
    joints = p.shape[0]
    own, began = rows(arm, x, joints)
    for j in range(joints):
        inertia, kp, kd, cutoff = p[j, 0], p[j, 1], p[j, 2], p[j, 3]
        e, de = arm.motion[0, j] - arm.desired[0, j], arm.motion[1, j] - arm.desired[1, j]
        forget = math.exp(-cutoff * arm.dt)
        faster = arm.motion[1, j] - own[Filtered.SECOND_BEFORE, j] if began else 0.0
        before = own[Filtered.FIRST_BEFORE, j] - cutoff * inertia * faster
        own[Filtered.FIRST, j] = forget * before + (1.0 - forget) * arm.effort[j]
        own[Filtered.SECOND, j] = arm.motion[1, j]
        effort = inertia * (arm.desired[2, j] - kd * de - kp * e) + own[Filtered.FIRST, j]
        demand[Demand.EQUIVALENT_ACCELERATION, j] = demand[Demand.ACCELERATION, j] = effort


DISTURBANCE_OBSERVER = arm_law(
    "disturbance_observer",
    "PD and a disturbance observer for each joint, without a model of the arm (Ohnishi et al. 1996)",
    (
        Parameter(
            "inertia", 1.0, "constant inertia J of the joint", "kg m^2", minimum=0.0, exclusive=True, per_joint=True
        ),
        Parameter("kp", 100.0, "gain of the error", "1/s^2", minimum=0.0, per_joint=True),
        Parameter("kd", 20.0, "gain of the velocity error", "1/s", minimum=0.0, per_joint=True),
        Parameter("cutoff", 60.0, "cutoff of the observer", "rad/s", minimum=0.0, exclusive=True, per_joint=True),
    ),
    command,
    advance,
    memory,
    uses_model=False,
)
