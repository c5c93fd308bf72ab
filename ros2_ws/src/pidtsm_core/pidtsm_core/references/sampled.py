"""A reference from a Python function."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Value
from pidtsm_core.parameters.sampling import sample
from pidtsm_core.references.base import Reference
from pidtsm_core.references.piecewise import evaluate, through


@dataclass(frozen=True)
class _Sampled(Reference):
    motion: Array = field(default_factory=lambda: np.zeros((1, 1)), repr=False, compare=False)

    def pack(self, values: Mapping[str, Value], group: str, joints: int) -> Array:
        """The motion, see `piecewise`."""
        return self.motion


def sampled_reference(
    name: str, summary: str, function: Callable[[float], ArrayLike], duration: float, period: float = 0.005
) -> Reference:
    """A reference from a Python function, for `register`; a cubic spline through its samples gives q_d' and q_d''.

    Args:
        name: the name by which users choose it.
        summary: one sentence.
        function: from time (s) to the position of each joint, shape (joints,), rad; any Python.
        duration: s; afterwards the reference rests.
        period: between two samples, s.

    Raises:
        MemberError: there are no two samples, the function returns something else than finite numbers, or not as many
            each time.
    """
    times, samples = sample(f"reference {name}", function, duration, period)
    return _Sampled(name, summary, (), samples.shape[1], evaluate, through(times, samples[:, np.newaxis]))
