"""What the controller remembers of joints in motion, so that they leave rest in the right way: see breakaway.py."""

from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array

FORTH, BACK = 0, 1
"""The directions in which a joint moves: to larger positions, or to smaller ones."""


class Rests(NamedTuple):
    """What is known of motion and rest of each joint; initially all zero."""

    moved: Array  # for how long it has moved along with its reference in each direction, shape (2, joints), s
    disturbance: Array  # mean of the disturbance meanwhile, likewise, rad/s^2
    rested: Array  # for how long its reference has rested, shape (joints,), s
    share: Array  # of `change` that was made since the reference began to leave, likewise
    change: Array  # by how much the disturbance shall change meanwhile, likewise, rad/s^2


def new_rests(joints: int) -> Rests:
    """Nothing is known."""
    return Rests(
        moved=np.zeros((2, joints)),
        disturbance=np.zeros((2, joints)),
        rested=np.zeros(joints),
        share=np.zeros(joints),
        change=np.zeros(joints),
    )
