"""The parts of a law with their gains: what conditions and bounds are about."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from pidtsm_core.arrays import Array
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import Value, joint_array

Gains: TypeAlias = Mapping[str, Array]
"""The numbers of a law by name without the prefix ``law.``, shape (joints,) each."""


@dataclass(frozen=True)
class Parts:
    """A law, taken apart.

    Attributes:
        law: its name.
        surface, manifold, reaching: names of its parts; empty for a law that has a formula of its own.
        gains: shape (joints,) each.
        joints: number of joints.
    """

    law: str
    surface: str
    manifold: str
    reaching: str
    gains: Gains
    joints: int

    @property
    def slides(self) -> bool:
        """Whether the law has a sliding variable."""
        return bool(self.surface)


def parts_of(values: Mapping[str, Value], joints: int) -> Parts:
    """The parts of the law of a controller.

    Args:
        values: every parameter of the controller, checked.
        joints: number of joints.
    """
    law = LAWS[str(values["law.name"])]
    own = {p.name: values[f"law.{p.name}"] for p in law.parameters(values)}
    gains = {
        name: joint_array(value, joints)
        for name, value in own.items()
        if not isinstance(value, (str, bool)) and name != "disturbance_rejection"
    }
    return Parts(law.name, *(law.parts(values) if law.parts else ("", "", "")), gains, joints)
