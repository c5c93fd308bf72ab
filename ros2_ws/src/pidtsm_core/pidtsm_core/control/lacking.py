"""What the observer tells about the arm, for what the controller learns: the effort that the model lacks, and velocity.

The disturbance d of the observer is an acceleration; -H d is the effort that the model lacks, see extended_state.py. If
d changes at the rate d', the observer's velocity is wrong by 3 d' / w^2 and its position by d' / w^3. Adding 3 w times
the error of the position cancels that of the velocity, as far as w is slow against the rate; one more pole at w bounds
the noise. Where friction is compensated, the law sees a velocity that is corrected likewise: at a reversal, the
disturbance changes so quickly that the arm would follow the error of the velocity.

White noise of standard deviation n of the position at the period T becomes noise of 1.3 n w sqrt(w T) of the velocity;
n is known from how the error of the position changes between two samples. A noisy velocity is neither corrected nor
learnt from.

An observer that knows the springs estimates the velocity of the links without such an error: it is taken as it is.
"""

import math

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.joint_friction import REVERSAL
from pidtsm_core.control.state import ControllerState, Friction, Noise, part
from pidtsm_core.estimators import DISTURBANCE
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.signals import Signal

_AMPLIFIED = 1.3
"""See above. With more noise than REVERSAL, friction looks smaller than it is."""
_LITTLE = 0.02
"""Friction with which the velocity is corrected fully, a share of the effort limit."""
_ABSURD = 1.0
"""rad; error of an estimated position that corrects nothing."""
_MEAN = 0.2
"""s, over which the noise is averaged."""
_LATELY = 3.0
"""s, in which large noise is forgotten."""


@part
def find_lacking(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Write ``state.lacking`` and ``state.learnt_velocity``, dt (s) after the last tick, from this tick's estimates."""
    motion, efforts, y = state.motion, state.scratch, state.signals
    for j in range(state.lacking.size):
        motion[0, j] = 0.0
        motion[1, j] = state.estimator[j, DISTURBANCE]
        motion[2, j] = 0.0
    inverse_dynamics(config.model, y[Signal.POSITION], motion[2], motion[:2], efforts[:2])
    for j in range(state.lacking.size):
        bandwidth = state.pace[0] * config.adaptation.bandwidth[j]
        error = state.measured[j] - y[Signal.POSITION, j]
        lags = 3.0 * bandwidth * error if config.adaptation.velocity_lags else 0.0
        velocity = y[Signal.VELOCITY, j] + lags
        state.lacking[j] = efforts[0, j] - efforts[1, j]
        gone = -math.expm1(-bandwidth * dt)
        wanted = lags * _rubs(config, state, j, dt) if abs(error) < _ABSURD else 0.0
        state.noise[Noise.CORRECTION, j] += gone * (wanted - state.noise[Noise.CORRECTION, j])
        y[Signal.VELOCITY, j] += state.noise[Noise.CORRECTION, j]
        if math.isfinite(state.lacking[j] + velocity):
            state.learnt_velocity[j] += gone * (velocity - state.learnt_velocity[j])


@part
def find_noise(state: ControllerState, dt: float) -> None:
    """Write ``state.noise``, dt (s) after the last tick, from this tick's estimates."""
    for j in range(state.measured.size):
        error = state.measured[j] - state.signals[Signal.POSITION, j]
        if math.isfinite(error):
            change = min(abs(error - state.noise[Noise.ERROR, j]), _ABSURD)
            state.noise[Noise.ERROR, j] = error
            variance = 0.5 * change * change - state.noise[Noise.VARIANCE, j]
            state.noise[Noise.VARIANCE, j] += -math.expm1(-dt / _MEAN) * variance
            lately = state.noise[Noise.LATELY, j] * math.exp(-dt / _LATELY)
            state.noise[Noise.LATELY, j] = max(lately, state.noise[Noise.VARIANCE, j])


@inlined
def _rubs(config: ControllerConfig, state: ControllerState, j: int, dt: float) -> float:
    """1 if joint j has friction that is found and compensated, 0 if not or in noise; in between if it is little."""
    if not config.adaptation.compensates_friction or is_noisy(config, state, j, dt):
        return 0.0
    friction = config.compensation.coulomb[j] + state.friction[Friction.USED, j]
    return min(friction / (_LITTLE * config.limits.effort[j]), 1.0)


@inlined
def is_noisy(config: ControllerConfig, state: ControllerState, joint: int, dt: float) -> bool:
    """Whether ``state.learnt_velocity`` of a joint does not tell its direction; dt is the period, s."""
    bandwidth = state.pace[0] * config.adaptation.bandwidth[joint]
    noise = _AMPLIFIED * bandwidth * math.sqrt(bandwidth * dt * state.noise[Noise.LATELY, joint])
    return noise > REVERSAL


@inlined
def is_known(state: ControllerState, joint: int) -> bool:
    """Whether the last estimates of a joint can be learnt from: they are finite."""
    return math.isfinite(state.lacking[joint] + state.signals[Signal.VELOCITY, joint] + state.measured[joint])
