"""Interface of a reaching law."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.parameters.family import Member


class Interval(NamedTuple):
    """A time step in which a state advances while its inputs are held."""

    dt: float  # s
    frozen: bool  # the effort was not the law's (limited, or the controller has stopped): nothing may wind up
    adaptation: int  # see `Adaptation`


@inlined
def keep(sigma: float, p: Array, x: Array, interval: Interval) -> None:
    """Leave the state x, shape (SLOTS,), as it is; the interval is in s."""


@dataclass(frozen=True)
class ReachingLaw(Member):
    """A reaching law of one joint: from the manifold variable sigma to the switching term tau_sw.

    Attributes:
        switch: compiled ``(sigma, p, x, dt) -> (tau_sw, gain)``, called at a sample before the state advances; dt is
            the period (s, 0 at the first sample); `gain` is the present switching gain (the adaptive gain, if any).
        advance: compiled ``(sigma, p, x, interval)``: advances the state x over the `Interval` while sigma is held;
            default: there is no state.
        prescribes_rate: whether the result of `switch` is the rate of sigma. The PID manifold then uses its integral,
            because there sigma equals tau_sw (eq. (32)).

    `p` and `x` have shape (SLOTS,); x starts at zero.
    """

    switch: Callable[[float, Array, Array, float], tuple[float, float]]
    advance: Callable[[float, Array, Array, Interval], None] = keep
    prescribes_rate: bool = True
