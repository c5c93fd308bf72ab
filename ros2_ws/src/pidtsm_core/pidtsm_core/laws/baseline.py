"""Common parts of the laws without sliding mode."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.laws.base import OWN_INTEGERS, Advance, Command, Integers, Kernel, Law
from pidtsm_core.laws.sliding_mode import ANTI_WINDUP
from pidtsm_core.parameters import Parameter, Value
from pidtsm_core.parameters.family import Member


@dataclass(frozen=True)
class LawOfMember:
    """What laws without parts of their own have in common, see `Law`."""

    member: Member

    def parameters(self, _settings: Mapping[str, object]) -> tuple[Parameter, ...]:
        return (*self.member.parameters, ANTI_WINDUP)

    def integers(self, _values: Mapping[str, Value]) -> Integers:
        return np.zeros(OWN_INTEGERS, dtype=np.int64)

    def pack(self, values: Mapping[str, Value], joints: int) -> Array:
        """See `Member.pack`."""
        return self.member.pack(values, "law", joints)


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
    own = LawOfMember(Member(name, summary, parameters))
    kernel = Kernel(command, advance)
    return Law(name, summary, own.parameters, own.integers, own.pack, lambda _integers: kernel, uses_model)
