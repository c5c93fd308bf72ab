"""Joints are matched by name, never by their index in an array."""

import math
from array import array
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array

ABSURD = 1e6
"""No angle, velocity or torque of an arm is as large as this, in any SI unit."""


class MessageError(ValueError):
    """A message cannot be used; the text contains the cause."""


class JointOrder:
    """Reads per-joint arrays of messages into the receiver's joint order."""

    def __init__(self, joints: Sequence[str], others: bool = False) -> None:
        """Begin without a message.

        Args:
            joints: joint names of the receiver, in its order.
            others: whether messages may have more joints, such as those of a gripper, which are ignored.
        """
        self.joints = list(joints)
        self._others = others
        self._last_names: list[str] | None = None
        self._order: NDArray[np.intp] = np.empty(0, dtype=np.intp)

    def match(self, names: Sequence[str]) -> NDArray[np.intp]:
        """Indices of the receiver's joints in `names`, shape (joints,).

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
            raise MessageError(f"a joint is named twice in [{', '.join(names)}]; expected: {expected}")
        unknown = [name for name in names if name not in self.joints]
        missing = [name for name in self.joints if name not in names]
        if unknown and not missing and not self._others:
            raise MessageError(f"unknown joints {', '.join(unknown)}; expected: {expected}")
        if unknown and missing:
            raise MessageError(f"unknown joints {', '.join(unknown)}, missing {', '.join(missing)}")
        if missing:
            raise MessageError(f"joints {', '.join(missing)} are missing; expected: {expected}")
        return np.array([list(names).index(name) for name in self.joints], dtype=np.intp)

    def read(self, names: Sequence[str], values: "array[float]", field: str, target: Array) -> None:
        """Copy `values` into `target`, shape (joints,), in the receiver's order.

        Raises:
            MessageError: the names do not match, an array has the wrong length, or a value is not finite or is absurd.
        """
        order = self.match(names)
        if len(values) != len(names):
            raise MessageError(f"{field} has {len(values)} values for {len(names)} joints")
        for name, value in ((names[place], values[place]) for place in order):
            if not -ABSURD < value < ABSURD:
                # Without the value: each cause is logged once, and values always differ.
                reason = "is absurd" if math.isfinite(value) else "is not finite"
                raise MessageError(f"{field} {reason}: {name}")
        for j, place in enumerate(order):
            target[j] = values[place]
