"""What a reaching law provides."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from pidtsm_core.family import Member
from pidtsm_core.parameters import Array


class Interval(NamedTuple):
    """The time over which a state moves, with what drives it held."""

    dt: float  # s
    frozen: bool  # the effort was not the law's (limited, or of a stopped controller): nothing must wind up
    adaptation: int  # see `Adaptation`


@dataclass(frozen=True)
class ReachingLaw(Member):
    """A reaching law of one joint: the manifold variable sigma to the switching term tau_sw.

    Attributes:
        switch: compiled ``(sigma, p, x, dt) -> (tau_sw, gain)`` at a sample, before its state advances; dt is the
            period (s, 0 at the first sample); `gain` is the switching gain in force (adaptive where there is one).
        advance: compiled ``(sigma, p, x, interval)``: moves the state x over the `Interval`, with sigma held.
        prescribes_rate: what `switch` gives is meant as the rate of sigma. The PID manifold, whose sigma holds
            tau_sw itself (eq. (32)), then takes its integral.

    `p` and `x` have shape (SLOTS,); x starts at zero.
    """

    switch: Callable[[float, Array, Array, float], tuple[float, float]]
    advance: Callable[[float, Array, Array, Interval], None]
    prescribes_rate: bool = True
