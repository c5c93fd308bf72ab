"""What a reaching law provides."""

from collections.abc import Callable
from dataclasses import dataclass

from pidtsm_core.family import Member
from pidtsm_core.parameters import Array


@dataclass(frozen=True)
class ReachingLaw(Member):
    """A reaching law of one joint: the manifold variable sigma to the switching term tau_sw (unit of sigma).

    Attributes:
        switch: compiled ``(sigma, p, x) -> (tau_sw, gain)`` at a sample, before its state advances; `gain` is the
            switching gain in force (the adaptive gain where there is one).
        advance: compiled ``(sigma, p, x, dt, frozen)``: moves the state x over dt seconds, with sigma held.
            `frozen` is true while the joint's torque saturates and adaptation must not wind up.

    `p` and `x` have shape (SLOTS,); x starts at zero.
    """

    switch: Callable[[float, Array, Array], tuple[float, float]]
    advance: Callable[[float, Array, Array, float, bool], None]
