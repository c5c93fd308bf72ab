"""Extended state observer with the robot model: the commanded torque determines most of the motion.

States of a joint are q, q' and the disturbance d, an acceleration that represents everything the model lacks:

    q'' = H(q)^-1 (effort - C(q, q') q' - G(q)) + d,   d' = 0

From the last sample to the present one, the states follow the model under the torque held in between. Then the
measurement corrects them, with gains that place all poles of the sampled error at exp(-bandwidth dt). A lost sample
only makes the prediction longer. The acceleration comes from the model, not from the measurement alone, so the
bandwidth, and with it the noise, can be far below that of a differentiator.

Assumptions: the robot model of the controller is roughly right; the motors deliver the torque commanded at the last
sample (a delay or lag of some milliseconds appears as a disturbance, which does no harm); d changes slowly.

The bandwidth w is the only parameter. If d changes at the rate r (rad/s^3), the errors settle at r / w^3 in q,
3 r / w^2 in q' and 3 r / w in q''. White noise of standard deviation n on q at period T causes noise of
n sqrt(w T) times 1.4 in q, 1.3 w in q' and 0.43 w^2 in d; q'' has the noise of d plus the model's response to the
noise of q and q'. So increase w until the noise of the torque, which grows with the inertia, reaches what the motors
tolerate: heavier joints need a lower w.

Han, "From PID to active disturbance rejection control", IEEE Transactions on Industrial Electronics 56(3), 2009; one
bandwidth: Gao, "Scaling and bandwidth-parameterization based controller tuning", American Control Conference 2003;
sampled gains ("current" form): Miklosovic, Radke and Gao, "Discrete implementation and generalization of the extended
state observer", American Control Conference 2006.
"""

import math

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit
from pidtsm_core.estimators.base import DISTURBANCE, Estimator, Sample
from pidtsm_core.parameters import Parameter
from pidtsm_core.robots import forward_dynamics

# State x: q, q', d (column DISTURBANCE), 1 after the first sample.

_ABSURD = 1e9  # rad, rad/s or rad/s^2; far above the values of any arm, far below overflow
_STEP = 1e-3  # s; longest step of the prediction between two samples
_SILENCE = 1.0  # s; after a longer gap between samples the motion of the arm is unknown


@njit
def _predict(sample: Sample, x: Array, q: Array, dq: Array, acceleration: Array) -> None:
    """Predict q and q' at the sample under the held effort; `acceleration` is scratch."""
    steps = math.ceil(sample.dt / _STEP)
    h = sample.dt / steps
    for j in range(q.size):
        q[j] = x[j, 0]
        dq[j] = x[j, 1]
    for _ in range(steps):
        forward_dynamics(sample.model, q, dq, sample.effort, acceleration)
        for j in range(q.size):
            ddq = acceleration[j] + x[j, DISTURBANCE]
            q[j] += h * (dq[j] + 0.5 * h * ddq)
            dq[j] += h * ddq


@njit
def _correct(innovation: float, dt: float, bandwidth: float) -> tuple[float, float, float]:
    """Corrections of q, q' and d for the measured minus the predicted q (rad): Miklosovic, Radke and Gao (2006)."""
    gone = -math.expm1(-bandwidth * dt)
    pole = 1.0 - gone
    return (
        gone * (1.0 + pole + pole * pole) * innovation,
        1.5 * gone * gone * (1.0 + pole) / dt * innovation,
        gone * gone * gone / (dt * dt) * innovation,
    )


@njit
def estimate(sample: Sample, p: Array, x: Array, estimates: Array) -> None:
    """The estimated q'' is the acceleration under the torque held before the sample.

    The arm is assumed to be at rest at the first sample, after a gap of more than one second, and after an absurd
    measurement that makes the states diverge.
    """
    q, dt = sample.q, sample.dt
    position, velocity, acceleration = estimates[0], estimates[1], estimates[2]
    known = x[0, 3] == 1.0 and 0.0 < dt <= _SILENCE
    if known:
        _predict(sample, x, position, velocity, acceleration)
        for j in range(q.size):
            of_q, of_dq, of_d = _correct(q[j] - position[j], dt, sample.pace * p[j, 0])
            position[j] += of_q
            velocity[j] += of_dq
            x[j, 0] = position[j]
            x[j, 1] = velocity[j]
            x[j, DISTURBANCE] += of_d
        forward_dynamics(sample.model, position, velocity, sample.effort, acceleration)
        for j in range(q.size):
            acceleration[j] += x[j, DISTURBANCE]
            for row in range(3):
                known = known and abs(estimates[row, j]) < _ABSURD
    if not known:
        for j in range(q.size):
            position[j] = x[j, 0] = q[j]
            velocity[j] = x[j, 1] = 0.0
            acceleration[j] = x[j, DISTURBANCE] = 0.0
            x[j, 3] = 1.0


EXTENDED_STATE_OBSERVER = Estimator(
    name="extended_state_observer",
    summary="q, q' and disturbance from measured position, commanded torque and robot model",
    parameters=(
        Parameter("bandwidth", 30.0, "all poles of the observer", "rad/s", minimum=0.0, exclusive=True, per_joint=True),
    ),
    estimate=estimate,
    finds_disturbance=True,
    teaches=frozenset({"adaptation.friction", "adaptation.lateness", "adaptation.softening"}),
    velocity_lags=True,
)
