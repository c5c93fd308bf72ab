"""What a reaching law provides."""

from collections.abc import Callable
from dataclasses import dataclass

from pidtsm_core.family import Member
from pidtsm_core.parameters import Array


@dataclass(frozen=True)
class ReachingLaw(Member):
    """A reaching law of one joint: the manifold variable sigma to the switching term tau_sw.

    Attributes:
        switch: compiled ``(sigma, p, x, dt) -> (tau_sw, gain)`` at a sample, before its state advances; dt is the
            period (s, 0 at the first sample); `gain` is the switching gain in force (adaptive where there is one).
        advance: compiled ``(sigma, p, x, dt, frozen, adaptation)``: moves the state x over dt seconds, with sigma
            held. `frozen` is true while the joint's effort is limited and nothing must wind up; for `adaptation` see
            `Adaptation`.
        prescribes_rate: what `switch` gives is meant as the rate of sigma. The PID manifold, whose sigma holds
            tau_sw itself (eq. (32)), then takes its integral.

    `p` and `x` have shape (SLOTS,); x starts at zero.
    """

    switch: Callable[[float, Array, Array, float], tuple[float, float]]
    advance: Callable[[float, Array, Array, float, bool, int], None]
    prescribes_rate: bool = True
