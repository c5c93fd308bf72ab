"""What a disturbance provides."""

from collections.abc import Callable
from dataclasses import dataclass

from pidtsm_core.family import Member
from pidtsm_core.parameters import Array


@dataclass(frozen=True)
class Disturbance(Member):
    """A torque F_d that acts on the joints beside the motors, eq. (5).

    Attributes:
        joints: number of joints it is made for, 0 for any.
        add: compiled ``(q, dq, effort)``; adds F_d to effort, N m, shape (joints,).
    """

    joints: int
    add: Callable[[Array, Array, Array], None]
