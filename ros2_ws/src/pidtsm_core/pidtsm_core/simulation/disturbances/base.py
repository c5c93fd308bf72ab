"""Interface of a disturbance."""

from collections.abc import Callable
from dataclasses import dataclass

from pidtsm_core.arrays import Array
from pidtsm_core.parameters.family import Member


@dataclass(frozen=True)
class Disturbance(Member):
    """A torque F_d that acts on the joints in addition to the motors, eq. (5).

    Attributes:
        joints: required number of joints; 0: any number.
        add: compiled ``(q, dq, effort)``; adds F_d to effort, N m, shape (joints,).
    """

    joints: int
    add: Callable[[Array, Array, Array], None]
