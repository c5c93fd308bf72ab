"""The arm that viewers draw: its description, and the positions of its joints in messages."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.parameters import ParameterError
from pidtsm_core.robots import DESCRIPTION, Description, find_description

GHOST = "reference"
"""Prefix of the frames of the second arm, which shows the reference."""


@dataclass(frozen=True)
class DrawnArm:
    """An arm, and the names of its joints in the recording.

    Attributes:
        description: the arm.
        joints: names in the recording, in the order of the joints of the description.
    """

    description: Description
    joints: tuple[str, ...]

    def positions(self, names: Sequence[str], values: Array) -> Array | None:
        """Positions in the order of the joints, shape (joints,), rad or m; None: one is missing or not finite.

        Args:
            names: of the values.
            values: positions, shape (names,) or (0,).
        """
        if len(values) != len(names) or not set(self.joints) <= set(names):
            return None
        found = np.array([values[list(names).index(joint)] for joint in self.joints], dtype=float)
        return found if np.isfinite(found).all() else None


def drawn_arm(settings: Mapping[str, object]) -> DrawnArm:
    """The arm of these parameters.

    Args:
        settings: parameters of the simulated arm, as in the metadata of a bag, or of `ArmDefinition.settings`.

    Raises:
        UsageError: there are none, or its description cannot be read; the message has the cure.
    """
    if not settings:
        raise UsageError("the recording does not name its arm; give it with --robot")
    try:
        arm = find_description(settings)
    except ParameterError as error:
        raise UsageError(f"{error}; give the arm with --robot") from None
    given = settings.get("joints", arm.joints)
    joints = (given,) if isinstance(given, str) else tuple(str(name) for name in given)  # type: ignore[attr-defined]
    if len(joints) != len(arm.joints):
        about = settings.get(DESCRIPTION.name, "the arm")
        raise UsageError(f"{about} has the joints {', '.join(arm.joints)}, not {', '.join(joints)}")
    return DrawnArm(arm, joints)
