"""Units of the quantities of a joint, which turns or slides."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np


class JointUnits(NamedTuple):
    """Units of a joint's position (also of its error) and of its effort."""

    position: str
    effort: str


TURNS = JointUnits("rad", "N m")
SLIDES = JointUnits("m", "N")


def joint_units(slides: Sequence[bool], joints: int) -> tuple[JointUnits, ...]:
    """The units of each joint.

    Args:
        slides: whether each joint slides; empty: all turn.
        joints: number of joints.
    """
    return tuple(SLIDES if each else TURNS for each in slides or (False,) * joints)


def alike(units: Sequence[JointUnits], most: int) -> list[list[int]]:
    """Indices of the joints in groups with the same units.

    Args:
        units: of each joint.
        most: largest number of joints in a group; groups of the same units are about equally large.
    """
    groups: list[list[int]] = []
    for each in dict.fromkeys(units):
        same = [joint for joint, other in enumerate(units) if other == each]
        groups += [part.tolist() for part in np.array_split(same, -(-len(same) // most))]
    return groups


def either(units: Iterable[str]) -> str:
    """All of these units, for a text about several joints, such as "rad or m"."""
    return " or ".join(dict.fromkeys(units))
