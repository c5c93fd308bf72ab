"""Base parameters: the combinations of an arm's parameters that its efforts depend on."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from pidtsm_core.arrays import Array
from pidtsm_core.identification.regressor import OF_JOINT, regressor
from pidtsm_core.robots.tree.unit_forces import LINK

_STATES = 60
"""Random states per parameter of a link; far more than the rank needs."""
_ZERO = 1e-4
"""A column, or what the others do not explain of one, has no effect if it is smaller, relative to the largest one.

Descriptions round angles, so that axes that are parallel differ by 4e-6 rad; no measurement can use that."""


@dataclass(frozen=True)
class BaseParameters:
    """Combinations beta = K pi that determine all efforts: Y pi = Y[:, columns] beta.

    Attributes:
        columns: the parameter to which each combination adds others, indices in pi, shape (base,).
        mapping: K, shape (base, parameters).
    """

    columns: NDArray[np.int_]
    mapping: Array

    def texts(self, names: Sequence[str]) -> tuple[str, ...]:
        """The combinations in words, such as ``joint1.Izz + 0.32 joint2.m``; names are those of pi."""
        return tuple(_combination(row, int(i), names) for row, i in zip(self.mapping, self.columns, strict=True))

    def without_effect(self, names: Sequence[str]) -> tuple[str, ...]:
        """Parameters that change no effort of this arm at all."""
        return tuple(name for name, column in zip(names, self.mapping.T, strict=True) if not column.any())

    def only_combined(self, names: Sequence[str]) -> tuple[str, ...]:
        """Parameters that change efforts only as parts of a combination with others."""
        alone = (np.count_nonzero(self.mapping, axis=1) == 1)[:, np.newaxis] & (self.mapping != 0.0)
        mixed = self.mapping.any(axis=0) & ~alone.any(axis=0)
        return tuple(name for name, is_mixed in zip(names, mixed, strict=True) if is_mixed)


def base_parameters(tree: Array, joints: int, among: NDArray[np.int_] | None = None) -> BaseParameters:
    """The base parameters of an arm, by QR with column pivoting of the regressor of random states.

    Gautier, Numerical calculation of the base inertial parameters of robots, J. Robotic Systems 8 (1991). Combinations
    are independent of data; which of them data determine is another question.

    Args:
        tree: see `tree.layout`, shape (size(joints),).
        joints: number of joints.
        among: indices in pi of the parameters that may differ from zero; None: all.
    """
    random = np.random.default_rng(0)
    q, dq, ddq = random.uniform(-3.0, 3.0, (3, _STATES * LINK // joints + _STATES, joints))
    stacked = regressor(tree, q, dq, ddq).reshape(-1, (LINK + len(OF_JOINT)) * joints)
    size = np.linalg.norm(stacked, axis=0)
    if among is not None:
        size[np.setdiff1d(np.arange(size.size), among)] = 0.0
    size[size < _ZERO * size.max()] = 0.0
    scale = np.where(size > 0.0, size, 1.0)
    triangle, order = qr(stacked * ((size > 0.0) / scale), mode="r", pivoting=True)
    triangle = triangle[: order.size]
    rank = int(np.count_nonzero(np.abs(np.diag(triangle)) > _ZERO * np.abs(triangle[0, 0])))
    combined = solve_triangular(triangle[:rank, :rank], triangle[:rank])
    mapping = np.zeros((rank, order.size))
    mapping[:, order] = combined * (scale[order] / scale[order[:rank], np.newaxis])
    mapping[np.abs(mapping) < _ZERO] = 0.0
    ranked = np.argsort(order[:rank])
    mapping = mapping[ranked]
    columns = order[:rank][ranked]
    mapping[np.arange(rank), columns] = 1.0
    return BaseParameters(columns, mapping)


def _combination(row: Array, column: int, names: Sequence[str]) -> str:
    """One combination in words, with its own parameter first."""
    others = [i for i in np.flatnonzero(row).tolist() if i != column]
    text = names[column]
    for i in others:
        factor = "" if abs(abs(row[i]) - 1.0) < 1e-6 else f"{abs(row[i]):.3g} "
        text += f" {'+' if row[i] > 0.0 else '-'} {factor}{names[i]}"
    return text
