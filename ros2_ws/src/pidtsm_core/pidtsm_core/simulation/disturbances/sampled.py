"""A disturbance from a Python function of time."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.parameters import Value
from pidtsm_core.parameters.sampling import sample
from pidtsm_core.simulation.disturbances.base import Disturbance


@dataclass(frozen=True)
class _Sampled(Disturbance):
    table: Array = field(default_factory=lambda: np.zeros((1, 1)), repr=False, compare=False)

    def pack(self, values: Mapping[str, Value], group: str, joints: int) -> Array:
        """Period (s), then the samples, shape (joints, n + 1)."""
        return self.table


@njit
def _add(t: float, q: Array, dq: Array, p: Array, effort: Array) -> None:
    """Interpolate the samples."""
    last = p.shape[1] - 2
    place = min(max(t / p[0, 0], 0.0), float(last))
    k = min(int(place), last - 1)
    for j in range(effort.size):
        effort[j] += p[j, 1 + k] + (place - k) * (p[j, 2 + k] - p[j, 1 + k])


def sampled_disturbance(
    name: str, summary: str, function: Callable[[float], ArrayLike], duration: float, period: float = 0.001
) -> Disturbance:
    """A disturbance from a Python function of time, for `register`; between its samples, it is a line.

    Args:
        name: the name by which users choose it.
        summary: one sentence.
        function: from time (s) to the torque on each joint, shape (joints,), N m; any Python.
        duration: s; afterwards the last torque stays.
        period: between two samples, s.

    Raises:
        MemberError: see `sampled_reference`.
    """
    _, samples = sample(f"disturbance {name}", function, duration, period)
    joints = samples.shape[1]
    return _Sampled(name, summary, (), joints, _add, np.hstack([np.full((joints, 1), period), samples.T]))
