"""Independent-joint PID with filtered derivative and anti-windup (Astrom and Hagglund 2006, section 3)."""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.laws.base import Integers
from pidtsm_core.laws.baseline import baseline
from pidtsm_core.laws.reaching import Interval
from pidtsm_core.parameters import Parameter

# State x: int e, filtered e', 1 after the first sample.


@njit
def _filtered(de: float, p: Array, x: Array, dt: float) -> float:
    """First-order low-pass filter of e', discretised exactly; its initial value is the first e'.

    It also begins anew after an e' that is not finite, which it would not forget.
    """
    if x[2] == 0.0 or not math.isfinite(x[1]):
        return de
    forget = math.exp(-p[3] * dt)
    return forget * x[1] + (1.0 - forget) * de


@njit
def command(
    e: float, de: float, dde: float, ddq_d: float, integers: Integers, p: Array, x: Array, dt: float
) -> tuple[float, float, float, float, float, float]:
    """-(Kp e + Ki int e + Kd e'_filtered), a torque; no robot model is used."""
    rate = _filtered(de, p, x, dt)
    x[1] = rate
    x[2] = 1.0
    effort = -(p[0] * e + p[1] * x[0] + p[2] * rate)
    return effort, effort, 0.0, 0.0, 0.0, 0.0


@njit
def advance(e: float, s: float, sigma: float, integers: Integers, p: Array, x: Array, interval: Interval) -> None:
    """Explicit Euler of int e."""
    if not interval.frozen:
        x[0] += interval.dt * e


PID = baseline(
    "pid",
    "independent-joint PID, without a model of the robot",
    (
        Parameter("kp", 500.0, "gain of the error", "N m/rad", minimum=0.0, per_joint=True),
        Parameter("ki", 500.0, "gain of the integral of the error", "N m/(rad s)", minimum=0.0, per_joint=True),
        Parameter("kd", 100.0, "gain of the velocity error", "N m s/rad", minimum=0.0, per_joint=True),
        Parameter(
            "derivative_cutoff", 200.0, "cutoff of the velocity error's filter", "rad/s", minimum=0.0, exclusive=True
        ),
    ),
    command,
    advance,
    uses_model=False,
)
