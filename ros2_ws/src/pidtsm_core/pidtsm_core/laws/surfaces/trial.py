"""Whether a surface from outside can be used."""

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import FLOAT, ROW, Interface, tuple_of
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.compiling.trial import check_finite, compiles
from pidtsm_core.errors import MemberError
from pidtsm_core.laws.surfaces.base import Surface
from pidtsm_core.parameters.family import check_parameters

_EVALUATE = Interface(tuple_of(FLOAT, 3)(FLOAT, FLOAT, FLOAT, ROW))
_evaluate = _EVALUATE.call
_POINTS = ((0.1, 0.2, 0.05), (-0.3, 0.7, -0.2), (0.4, -0.5, 0.1), (-0.02, -0.04, 0.0))
"""e (rad), e' (rad/s), integral of e (rad s); not zero, where a terminal surface may be singular."""
_STEP = 1e-6
_EXACT = 1e-3


@njit
def _at(address: int, e: float, de: float, integral: float, p: Array) -> tuple[float, float, float]:
    """Evaluate the surface at an address."""
    return _evaluate(address, e, de, integral, p)


def try_member(surface: Surface) -> None:
    """Compile a surface with its default parameters, and compare g and h with the differences of s.

    Raises:
        MemberError: its parameters do not fit, it does not compile, it returns what is not finite, or its g and h
            are not those of its s.
    """
    what = f"surface {surface.name}"
    check_parameters(what, surface.parameters)
    p = surface.pack({f"law.{each.name}": each.default for each in surface.parameters}, "law", 1)[0]
    with compiles(what):
        address = _EVALUATE.address(surface.evaluate)
    for point in _POINTS:
        given = "e = {:g}, e' = {:g}, integral = {:g}".format(*point)
        s, g, h = _at(address, point[0], point[1], point[2], p)
        check_finite(what, (s, g, h), given)
        by_e, by_de, by_integral = (_difference(address, np.array(point), i, p) for i in range(3))
        for name, value, expected, meaning in (
            ("g", g, by_de, "ds/de'"),
            ("h", h, by_e * point[1] + by_integral * point[0], "ds/de e' + ds/d(int e) e"),
        ):
            if abs(value - expected) > _EXACT * max(abs(expected), abs(value), 1e-3):
                raise MemberError(f"{what}: {name} is {value:.6g} for {given}, but {meaning} is {expected:.6g}")


def _difference(address: int, point: Array, i: int, p: Array) -> float:
    """Derivative of s by the i-th argument, by a central difference."""
    step = np.zeros(3)
    step[i] = _STEP
    above, below = point + step, point - step
    upper, lower = (_at(address, each[0], each[1], each[2], p)[0] for each in (above, below))
    return (upper - lower) / (2.0 * _STEP)
