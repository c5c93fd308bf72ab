"""Common functions of reaching laws without state: sign(sigma) as in eq. (25), and an `advance` that does nothing."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.laws.reaching.base import Interval


@inlined
def sign(x: float) -> float:
    """-1, 0 or 1."""
    return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)


@inlined
def keep(sigma: float, p: Array, x: Array, interval: Interval) -> None:
    """Leave the state unchanged; see `ReachingLaw.advance`."""
