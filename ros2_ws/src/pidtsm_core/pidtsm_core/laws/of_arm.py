"""What the laws of the whole arm have in common.

The columns of the inertia matrix are efforts of unit accelerations (Walker and Orin 1982, method 1).
"""

import math
from collections.abc import Callable

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.base import ArmAdvance, ArmCommand, ArmKernel, Law
from pidtsm_core.laws.baseline import LawOfMember
from pidtsm_core.parameters import Parameter
from pidtsm_core.parameters.family import Member
from pidtsm_core.robots import Model, inverse_dynamics


def arm_law(
    name: str,
    summary: str,
    parameters: tuple[Parameter, ...],
    command: ArmCommand,
    advance: ArmAdvance,
    memory: Callable[[int], int],
    uses_model: bool = True,
    needs_tree: bool = False,
) -> Law:
    """A law of the whole arm.

    Args:
        name: the name by which users choose it.
        summary: one sentence with its source.
        parameters: at most SLOTS, in the order in which the compiled functions read them.
        command: see `ArmKernel`.
        advance: likewise.
        memory: see `Law`.
        uses_model: likewise.
        needs_tree: likewise.
    """
    own, kernel = LawOfMember(Member(name, summary, parameters)), ArmKernel(command, advance)
    return Law(
        name,
        summary,
        own.parameters,
        own.integers,
        own.pack,
        lambda _integers: kernel,
        uses_model,
        memory=memory,
        needs_tree=needs_tree,
    )


@inlined
def signed_power(value: float, exponent: float) -> float:
    """|value|^exponent with the sign of the value."""
    return math.copysign(abs(value) ** exponent, value)


@inlined
def write_inertia(model: Model, q: Array, rows: Array, efforts: Array, inertia: Array) -> None:
    """Write the inertia matrix (kg m^2) and, to the first row of `efforts`, the effort that carries the arm (N m).

    Args:
        model: of the arm.
        q: shape (joints,), rad.
        rows: scratch, shape (joints + 1, joints).
        efforts: scratch, likewise.
        inertia: result, shape (joints, joints).
    """
    joints = q.size
    for i in range(joints + 1):
        for j in range(joints):
            rows[i, j] = 1.0 if i == j + 1 else 0.0
    inverse_dynamics(model, q, rows[0], rows, efforts)
    for i in range(joints):
        for j in range(joints):
            inertia[i, j] = 0.5 * (efforts[i + 1, j] + efforts[j + 1, i] - efforts[0, j] - efforts[0, i])
