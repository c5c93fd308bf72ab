"""Computed torque: inverse dynamics with PD (Spong, Hutchinson and Vidyasagar 2006, section 8.3)."""

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.laws.base import Integers
from pidtsm_core.laws.baseline import baseline
from pidtsm_core.laws.reaching import Interval
from pidtsm_core.parameters import Parameter


@njit
def command(
    e: float, de: float, dde: float, ddq_d: float, integers: Integers, p: Array, x: Array, dt: float
) -> tuple[float, float, float, float, float, float]:
    """q_d'' - Kd e' - Kp e."""
    acceleration = ddq_d - p[1] * de - p[0] * e
    return acceleration, acceleration, 0.0, 0.0, 0.0, 0.0


@njit
def advance(e: float, s: float, sigma: float, integers: Integers, p: Array, x: Array, interval: Interval) -> None:
    """This law has no state."""


COMPUTED_TORQUE = baseline(
    "computed_torque",
    "inverse dynamics with PD",
    (
        Parameter("kp", 100.0, "gain of the error", "1/s^2", minimum=0.0, per_joint=True),
        Parameter("kd", 20.0, "gain of the velocity error", "1/s", minimum=0.0, per_joint=True),
    ),
    command,
    advance,
)
