"""Point-to-point motion with minimum jerk."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Parameter, Value, as_float, joint_array
from pidtsm_core.references.base import SHORTEST, Reference
from pidtsm_core.references.piecewise import evaluate, piecewise


@dataclass(frozen=True)
class _PointToPoint(Reference):
    def pack(self, values: Mapping[str, Value], group: str, joints: int) -> Array:
        """One segment, shape (joints, 8); see `piecewise`."""
        ends = np.zeros((2, 1, 3, joints))
        ends[0, 0, 0] = joint_array(values[f"{group}.from"], joints)
        ends[1, 0, 0] = joint_array(values[f"{group}.to"], joints)
        return piecewise(np.array([0.0, as_float(values[f"{group}.duration"])]), ends[0], ends[1])


MINIMUM_JERK = _PointToPoint(
    name="minimum_jerk",
    summary="point to point with minimum jerk, then at rest: the quintic of Flash and Hogan (1985)",
    parameters=(
        Parameter("from", 0.0, "position at the start", "rad", per_joint=True, read_only=True),
        Parameter("to", 0.5, "position at the end", "rad", per_joint=True, read_only=True),
        Parameter("duration", 2.0, "time from start to end", "s", minimum=SHORTEST, read_only=True),
    ),
    joints=0,
    evaluate=evaluate,
)
