"""A sine with a frequency sweep, which excites a joint over a frequency band."""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.parameters import Parameter
from pidtsm_core.references.base import Reference


@njit
def evaluate(t: float, p: Array, desired: Array) -> None:
    """q_d = amplitude sin(angle); angle' changes linearly from the start to the end frequency, then stays constant."""
    for j in range(desired.shape[1]):
        amplitude, start, end, duration = p[j, 0], 2.0 * math.pi * p[j, 1], 2.0 * math.pi * p[j, 2], p[j, 3]
        rate = (end - start) / duration if t < duration else 0.0
        swept = min(t, duration)
        angle = swept * (start + 0.5 * swept * (end - start) / duration) + (t - swept) * end
        omega = start + rate * t if t < duration else end
        sine, cosine = math.sin(angle), math.cos(angle)
        desired[0, j] = amplitude * sine
        desired[1, j] = amplitude * omega * cosine
        desired[2, j] = amplitude * (rate * cosine - omega * omega * sine)


CHIRP = Reference(
    name="chirp",
    summary="amplitude times a sine whose frequency sweeps linearly and then stays constant",
    parameters=(
        Parameter("amplitude", 0.1, "amplitude", "rad", per_joint=True, read_only=True),
        Parameter("start_frequency", 0.1, "frequency at the start", "Hz", minimum=0.0, per_joint=True, read_only=True),
        Parameter("end_frequency", 1.0, "frequency at the end", "Hz", minimum=0.0, per_joint=True, read_only=True),
        Parameter(
            "duration", 20.0, "duration of the sweep", "s", minimum=0.0, exclusive=True, per_joint=True, read_only=True
        ),
    ),
    joints=0,
    evaluate=evaluate,
)
