"""Reaching laws: from sigma to the switching term. One law per file; `REACHING_LAWS` contains those imported here."""

from numba import typeof
from numba.core.types import none
from numba.core.types.containers import UniTuple

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.compiling.parts import FLOAT, ROW, by_index
from pidtsm_core.laws.reaching.adaptive_continuous import ADAPTIVE_CONTINUOUS
from pidtsm_core.laws.reaching.base import Interval, ReachingLaw
from pidtsm_core.laws.reaching.boundary_layer import BOUNDARY_LAYER
from pidtsm_core.laws.reaching.constant import CONSTANT
from pidtsm_core.laws.reaching.exponential import EXPONENTIAL
from pidtsm_core.laws.reaching.power_rate import POWER_RATE
from pidtsm_core.laws.reaching.super_twisting import SUPER_TWISTING
from pidtsm_core.parameters.family import Family

__all__ = ["REACHING_LAWS", "Interval", "ReachingLaw", "advance_reaching", "switch"]

REACHING_LAWS: Family[ReachingLaw] = Family.of(ReachingLaw, globals())

INTERVAL = typeof(Interval(0.0, False, 0))
_switch = by_index(
    [law.switch for law in REACHING_LAWS.members],
    UniTuple(FLOAT, 2)(FLOAT, ROW, ROW, FLOAT),
)
_advance = by_index(
    [law.advance for law in REACHING_LAWS.members],
    none(FLOAT, ROW, ROW, INTERVAL),
)


@njit
def switch(index: int, sigma: float, p: Array, x: Array, dt: float) -> tuple[float, float]:
    """(tau_sw, gain) of a law on its own: see `ReachingLaw.switch`; `index` is the law's place in `REACHING_LAWS`."""
    return _switch(index, sigma, p, x, dt)


@njit
def advance_reaching(index: int, sigma: float, p: Array, x: Array, interval: Interval) -> None:
    """Advance x over the interval: see `ReachingLaw.advance`; `index` is the law's place in `REACHING_LAWS`."""
    _advance(index, sigma, p, x, interval)
