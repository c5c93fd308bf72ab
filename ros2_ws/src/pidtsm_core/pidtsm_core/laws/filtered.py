"""Memory of a law that knows no model, and sees through filters what else acts on each joint.

Two quantities are filtered, each with a low pass that is exact for a held input (Astrom and Wittenmark 1997,
chapter 2).
"""

from enum import IntEnum

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined, njit
from pidtsm_core.laws.base import ArmSample
from pidtsm_core.robots import inverse_dynamics


class Filtered(IntEnum):
    """Rows of the memory, per joint; behind them a number, which is 1 after the first sample."""

    FIRST_BEFORE = 0  # the first quantity at the last sample
    SECOND_BEFORE = 1
    FIRST = 2  # at this sample
    SECOND = 3
    REST = 4  # scratch


ROWS = len(Filtered)


def memory(joints: int) -> int:
    """See `Law.memory`."""
    return ROWS * joints + 1


@inlined
def rows(arm: ArmSample, x: Array, joints: int) -> tuple[Array, bool]:
    """The rows of the memory x (flat), shape (len(Filtered), joints), and whether there was a sample before.

    At the first sample, the first quantity is the effort that carries the arm by its model, N m: without it, an arm
    would fall until it has been seen falling.
    """
    own = x[: ROWS * joints].reshape((ROWS, joints))
    began = x[ROWS * joints] != 0.0
    if not began:
        rest, carries = own[Filtered.REST :], own[Filtered.FIRST_BEFORE : Filtered.SECOND_BEFORE]
        for j in range(joints):
            rest[0, j] = 0.0
        inverse_dynamics(arm.model, arm.motion[0], rest[0], rest, carries)
    return own, began


@njit
def advance(p: Array, x: Array, frozen: Array, dt: float, adaptation: int) -> None:
    """See `ArmKernel.advance`. The filters see the effort that was applied, so nothing winds up."""
    joints = p.shape[0]
    for k in range(Filtered.FIRST * joints):
        x[k] = x[Filtered.FIRST * joints + k]
    x[ROWS * joints] = 1.0
