"""What the laws of the whole arm have in common; see Slotine and Li, Applied Nonlinear Control, 1991, chapter 9."""

import math
from collections.abc import Callable

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.base import ArmAdvance, ArmCommand, ArmKernel, Law
from pidtsm_core.laws.baseline import LawOfMember
from pidtsm_core.parameters import Parameter
from pidtsm_core.parameters.family import Member


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
