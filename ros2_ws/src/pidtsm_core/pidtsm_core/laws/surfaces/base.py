"""Interface of a sliding surface."""

from collections.abc import Callable
from dataclasses import dataclass

from pidtsm_core.arrays import Array
from pidtsm_core.parameters.family import Member


@dataclass(frozen=True)
class Surface(Member):
    """A sliding surface s(e, e', integral of e) of one joint whose derivative is affine in e'': s' = g e'' + h.

    Attributes:
        evaluate: compiled ``(e, de, integral, p) -> (s, g, h)``: e in rad, de in rad/s, integral in rad s;
            p has shape (SLOTS,) and the order of `parameters`.
    """

    evaluate: Callable[[float, float, float, Array], tuple[float, float, float]]
