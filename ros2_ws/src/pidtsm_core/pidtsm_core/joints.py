"""Joints are matched by name, never by their place in an array."""

import math
from array import array
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.parameters import Array

ABSURD = 1e6
"""No angle, rate or torque of an arm is that large, in any SI unit."""


class MessageError(ValueError):
    """A message cannot be used; the text names the cause."""


class JointOrder:
    """Reads per-joint arrays of messages in the order of one's own joints."""

    def __init__(self, joints: Sequence[str]) -> None:
        """Args: joints: own joint names, in one's own order."""
        self.joints = list(joints)
        self._last_names: list[str] | None = None
        self._order: NDArray[np.intp] = np.empty(0, dtype=np.intp)

    def match(self, names: Sequence[str]) -> NDArray[np.intp]:
        """Places of one's own joints in `names`, shape (joints,).

        Raises:
            MessageError: a joint is missing, unknown or named twice.
        """
        if names != self._last_names:
            self._order = self._places(names)
            self._last_names = list(names)
        return self._order

    def _places(self, names: Sequence[str]) -> NDArray[np.intp]:
        expected = ", ".join(self.joints)
        if len(set(names)) != len(names):
            raise MessageError(f"a joint is named twice in [{', '.join(names)}]; expected are {expected}")
        unknown = [name for name in names if name not in self.joints]
        missing = [name for name in self.joints if name not in names]
        if unknown and not missing:
            raise MessageError(f"unknown joints {', '.join(unknown)}; expected are {expected}")
        if unknown:
            raise MessageError(f"unknown joints {', '.join(unknown)}, missing {', '.join(missing)}")
        if missing:
            raise MessageError(f"joints {', '.join(missing)} are missing; expected are {expected}")
        return np.array([list(names).index(name) for name in self.joints], dtype=np.intp)

    def read(self, names: Sequence[str], values: "array[float]", field: str, target: Array) -> None:
        """Copy `values` into `target`, shape (joints,), in one's own order.

        Raises:
            MessageError: names that do not match, an array of another length, or a value that is not finite, or absurd.
        """
        order = self.match(names)
        if len(values) != len(self.joints):
            raise MessageError(f"{field} has {len(values)} values for {len(self.joints)} joints")
        for name, value in zip(names, values, strict=True):
            if not -ABSURD < value < ABSURD:
                # Not the value: the log gets every cause once, and no two values are alike.
                reason = "is absurd" if math.isfinite(value) else "is not finite"
                raise MessageError(f"{field} {reason}: {name}")
        for j, place in enumerate(order):
            target[j] = values[place]
