"""A condition of a theory on a set of gains: its name, formula, values and verdict."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array

Truths: TypeAlias = NDArray[np.bool_]
Roots: TypeAlias = tuple[tuple[complex, ...], ...]
"""Roots of a polynomial, 1/s, by joint, the slowest one first."""

_ROUNDING = 1e-12
"""Share of the largest root below which a real part is rounding."""


class Verdict(Enum):
    """What a check finds."""

    HOLDS = "holds"
    VIOLATED = "violated"
    NOT_COVERED = "not covered"
    """The set has something that the proof does not have: it may work, but the theorem does not promise it."""


@dataclass(frozen=True)
class Condition:
    """A condition on a set of gains.

    Attributes:
        name: short and unique among the conditions of a law.
        equation: where it comes from: an equation of the article, or the author and year of another one.
        formula: the condition.
        values: what it is judged by, by name: one number per joint.
        verdict: of the joint where it is worst.
        joints: indices of the joints that it does not hold for, from 0; empty if it holds.
        cure: what follows and what to do, one sentence; empty if it holds.
        roots: of the polynomial that it is about; empty if it is about none.
    """

    name: str
    equation: str
    formula: str
    values: Mapping[str, tuple[float, ...]]
    verdict: Verdict
    joints: tuple[int, ...] = ()
    cure: str = ""
    roots: Roots = ()

    def to_json(self) -> dict[str, Any]:
        """The condition as plain dictionaries, lists, texts and numbers; a root is [real part, imaginary part]."""
        return {
            "name": self.name,
            "equation": self.equation,
            "formula": self.formula,
            "values": {name: list(each) for name, each in self.values.items()},
            "roots": [[[root.real, root.imag] for root in of_joint] for of_joint in self.roots],
            "verdict": self.verdict.value,
            "joints": list(self.joints),
            "cure": self.cure,
        }


def required(
    name: str,
    equation: str,
    formula: str,
    values: Mapping[str, Array],
    holds: Truths,
    cure: str,
    roots: Roots = (),
) -> Condition:
    """A condition that holds or is violated.

    Args:
        name: see `Condition`.
        equation: likewise.
        formula: likewise.
        values: arrays of shape (joints,).
        holds: for each joint, shape (joints,).
        cure: see `Condition`.
        roots: likewise.
    """
    failing = tuple(np.flatnonzero(~holds).tolist())
    verdict = Verdict.VIOLATED if failing else Verdict.HOLDS
    return Condition(name, equation, formula, _numbers(values), verdict, failing, cure if failing else "", roots)


def not_covered(
    name: str, equation: str, formula: str, values: Mapping[str, Array], where: Truths, consequence: str
) -> list[Condition]:
    """What a proof does not have, if any joint has it: `where`, shape (joints,); see `required` for the others."""
    having = tuple(np.flatnonzero(where).tolist())
    if not having:
        return []
    return [Condition(name, equation, formula, _numbers(values), Verdict.NOT_COVERED, having, consequence)]


def positive(name: str, equation: str, symbol: str, values: Array, cure: str) -> Condition:
    """The condition that a gain is above 0; `values` has shape (joints,), see `required` for the others."""
    return required(name, equation, f"{symbol} > 0", {symbol: values}, values > 0.0, cure)


def hurwitz(
    name: str, equation: str, formula: str, coefficients: Mapping[str, Array], polynomials: Iterable[Array], cure: str
) -> Condition:
    """The condition that all roots of a polynomial have negative real parts.

    Args:
        name: see `Condition`.
        equation: likewise.
        formula: the polynomial in x.
        coefficients: the gains by name, shape (joints,) each.
        polynomials: coefficients of each joint, the highest power first, shape (degree + 1,).
        cure: see `Condition`.
    """
    roots = tuple(roots_of(each) for each in polynomials)
    holds = np.array([_stable(each) for each in roots])
    return required(name, equation, f"{formula} is Hurwitz", coefficients, holds, cure, roots)


def roots_of(polynomial: Array | Sequence[float]) -> tuple[complex, ...]:
    """Roots of a polynomial, 1/s, the slowest one first.

    Args:
        polynomial: its coefficients, the highest power first, shape (degree + 1,).
    """
    found = sorted(np.roots(polynomial), key=lambda root: (-root.real, root.imag))
    return tuple(complex(root) for root in found)


def _stable(roots: tuple[complex, ...]) -> bool:
    size = max((abs(root) for root in roots), default=0.0)
    return all(root.real < -_ROUNDING * size for root in roots)


def _numbers(values: Mapping[str, Array]) -> dict[str, tuple[float, ...]]:
    return {name: tuple(float(each) for each in array) for name, array in values.items()}
