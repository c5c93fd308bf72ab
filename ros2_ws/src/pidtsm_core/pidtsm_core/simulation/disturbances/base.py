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
        add: compiled ``(t, q, dq, p, effort)``: t in s, q in rad and dq in rad/s of shape (joints,); p as `pack`
            returns it, shape (joints, SLOTS) unless the disturbance packs more; adds F_d to effort, N m, shape
            (joints,).
    """

    joints: int
    add: Callable[[float, Array, Array, Array, Array], None]
