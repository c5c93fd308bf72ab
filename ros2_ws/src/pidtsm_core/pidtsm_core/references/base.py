"""Interface of a reference."""

from collections.abc import Callable
from dataclasses import dataclass

from pidtsm_core.arrays import Array
from pidtsm_core.parameters.family import Member

SHORTEST = 1e-6
"""Shortest time of a move, s: in less, velocities and accelerations may not be finite."""


@dataclass(frozen=True)
class Reference(Member):
    """A desired motion with its exact derivatives.

    Attributes:
        joints: required number of joints; 0: any number.
        evaluate: compiled ``(t, p, desired)``: t in s from the start; p as `pack` returns it, shape (joints, SLOTS)
            unless the reference packs more; writes q_d (rad), q_d' (rad/s), q_d'' (rad/s^2) to desired,
            shape (3, joints).
    """

    joints: int
    evaluate: Callable[[float, Array, Array], None]
