"""Whether a reaching law from outside can be used."""

import numpy as np
from numba import typeof

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.addresses import FLOAT, NOTHING, ROW, Interface, tuple_of
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.compiling.trial import check_finite, compiles
from pidtsm_core.laws.reaching.base import Interval, ReachingLaw
from pidtsm_core.parameters.family import SLOTS, check_parameters
from pidtsm_core.signals import Adaptation

_SWITCH = Interface(tuple_of(FLOAT, 2)(FLOAT, ROW, ROW, FLOAT))
_ADVANCE = Interface(NOTHING(FLOAT, ROW, ROW, typeof(Interval(0.0, False, 0))))
_switch, _advance = _SWITCH.call, _ADVANCE.call
_DT = 0.001


@njit
def _step(switch: int, advance: int, sigma: float, p: Array, x: Array, interval: Interval) -> tuple[float, float]:
    """Evaluate the reaching law at these addresses, and advance its state."""
    result = _switch(switch, sigma, p, x, interval.dt)
    _advance(advance, sigma, p, x, interval)
    return result


def try_member(law: ReachingLaw) -> None:
    """Compile a reaching law with its default parameters, and see what it returns for some values of sigma.

    Raises:
        MemberError: its parameters do not fit, it does not compile, or it returns what is not finite.
    """
    what = f"reaching law {law.name}"
    check_parameters(what, law.parameters)
    p = law.pack({f"law.{each.name}": each.default for each in law.parameters}, "law", 1)[0]
    with compiles(what):
        switch, advance = _SWITCH.address(law.switch), _ADVANCE.address(law.advance)
    interval = Interval(_DT, False, Adaptation.NORMAL.value)
    for sigma in (0.0, 1e-3, -0.2, 3.0, -1e3):
        x = np.zeros(SLOTS)
        for _ in range(3):
            result = _step(switch, advance, sigma, p, x, interval)
            check_finite(what, (*result, *x), f"sigma = {sigma:g}")
