"""A sine for each joint."""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.parameters import Parameter
from pidtsm_core.references.base import Reference


@njit
def evaluate(t: float, p: Array, desired: Array) -> None:
    """q_d = offset + amplitude sin(2 pi frequency t + phase), and its derivatives."""
    for j in range(desired.shape[1]):
        amplitude, frequency, phase, offset = p[j, 0], p[j, 1], p[j, 2], p[j, 3]
        omega = 2.0 * math.pi * frequency
        angle = omega * t + phase
        swing = amplitude * math.sin(angle)
        desired[0, j] = offset + swing
        desired[1, j] = amplitude * omega * math.cos(angle)
        desired[2, j] = -omega * omega * swing


SINES = Reference(
    name="sines",
    summary="offset + amplitude sin(2 pi frequency t + phase)",
    parameters=(
        Parameter("amplitude", 0.3, "amplitude", "rad", per_joint=True, read_only=True),
        Parameter("frequency", 0.2, "frequency", "Hz", minimum=0.0, per_joint=True, read_only=True),
        Parameter("phase", 0.0, "phase at the start", "rad", per_joint=True, read_only=True),
        Parameter("offset", 0.0, "middle of the motion", "rad", per_joint=True, read_only=True),
    ),
    joints=0,
    evaluate=evaluate,
)
