"""Common parts of the laws without sliding mode."""

from collections.abc import Mapping

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.laws.base import OWN_INTEGERS, Advance, Command, Integers, Kernel, Law
from pidtsm_core.laws.sliding_mode import ANTI_WINDUP
from pidtsm_core.parameters import Parameter, Value
from pidtsm_core.parameters.family import Member


def baseline(
    name: str,
    summary: str,
    parameters: tuple[Parameter, ...],
    command: Command,
    advance: Advance,
    uses_model: bool = True,
) -> Law:
    """A law with functions of its own, not composed of parts.

    Args:
        name: the name by which users choose it.
        summary: one sentence with its source.
        parameters: at most SLOTS, in the order in which the compiled functions read them.
        command: see `Kernel`.
        advance: see `Kernel`.
        uses_model: see `Law.uses_model`.
    """
    member = Member(name, summary, parameters)

    def of_group(settings: Mapping[str, object]) -> tuple[Parameter, ...]:
        return (*parameters, ANTI_WINDUP)

    def integers(values: Mapping[str, Value]) -> Integers:
        return np.zeros(OWN_INTEGERS, dtype=np.int64)

    def pack(values: Mapping[str, Value], joints: int) -> Array:
        return member.pack(values, "law", joints)

    def kernel(_chosen: Integers) -> Kernel:
        return Kernel(command, advance)

    return Law(name, summary, of_group, integers, pack, kernel, uses_model)
