"""Softening: an arm whose torque is rougher than its drives bear follows in a slower time, until it is quiet.

Let e'' = -u(e, e', int e) be the error that a law leaves. With a pace 0 < f <= 1, the error of

    -u_f(e, e', int e) = -f^2 u(e, e'/f, f int e)

is the same in a time that passes f times as fast (substitute t f for t). So every law, linear or not, is f times slower
and exactly as well damped; its own states advance with the period f dt, and the acceleration of the reference, which is
fed forward, is not scaled. The observer gets f times its bandwidth. Noise of the position then causes f^3 times the
change of the torque from one sample to the next, because the disturbance that the observer finds has the gain w^3.
All joints have the same pace: the inertia matrix passes the noise of one on to the torque of the others.

The roughness of a joint is the mean change of its command from one sample to the next, without the slow part, which
moves the arm, as a share of the effort limit. What one sample counts for is bounded, so a reversal of friction, a push
or a collision is not rough. If a joint exceeds ``adaptation.roughness``, the pace falls as fast as the mean can follow,
by the cube root of what is too much. Once all are below a fifth of it, the pace returns within some ten seconds; in
between it stays, so it does not oscillate: returning by what the mean may have missed cannot make the torque five
times as rough. The pace never falls below a quarter: an arm that is rough for another reason must not go limp. And an
arm that strays by more than noise explains, because its friction is not known for example, is stiffened again: there,
to follow matters more than to be quiet.

The same idea, for the gain of an axis: the slew rate limiter of ArduPilot (AC_PID). Scaling time: Hollerbach, "Dynamic
scaling of manipulator trajectories", Journal of Dynamic Systems, Measurement, and Control 106(1), 1984.
"""

import math

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.state import ControllerState, Noise, Softness, part
from pidtsm_core.signals import Mode, Signal, Status

_SLOW = 0.005
"""s; changes that last longer move the arm."""
_MEAN = 0.2
"""s, over which the roughness is averaged."""
_AT_MOST = 4.0
"""What a single sample counts for at most, relative to ``adaptation.roughness``."""
_QUIET = 0.2
"""Roughness relative to the same, below which the pace returns."""
_RETURNS = 10.0
"""s, in which the pace grows by the factor e."""
_EXPONENT = 3.0
"""Of the pace, in the roughness."""
_AVERAGED = 0.2
"""s, over which the error is averaged, so that ringing does not count."""
_FAR, _FAR_AT_LEAST = 5.0, 2e-3
"""Standard deviations of the noise of a position, and rad, beyond which a joint strays."""
_STIFFENS, _FORGIVES = 0.2, 30.0
"""s, in which an arm that strays may be softened less by the factor e, and more again if it does not."""
_SLOWEST = math.log(4.0)
"""Largest softening: a quarter of the pace."""


@part
def soften(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Judge the last command, which was sent dt (s) ago: ``state.softness``; and adapt the pace."""
    works = state.status[Status.FAULT] == 0 and state.status[Status.MODE] != Mode.FREEDRIVE
    sent = state.commanded if config.drive.late else state.sent
    slow, gone, roughest = -math.expm1(-dt / _SLOW), -math.expm1(-dt / _MEAN), 0.0
    for j in range(sent.size):
        bears = config.adaptation.roughness[j]
        change = (sent[j] - state.softness[Softness.SENT, j]) / config.limits.effort[j]
        state.softness[Softness.SENT, j] = sent[j]
        if works:
            state.softness[Softness.TREND, j] += slow * (change - state.softness[Softness.TREND, j])
            rough = min(abs(change - state.softness[Softness.TREND, j]), _AT_MOST * bears)
            mean = state.softness[Softness.ROUGHNESS, j]
            state.softness[Softness.ROUGHNESS, j] += gone * (rough - mean)
            roughest = max(roughest, state.softness[Softness.ROUGHNESS, j] / bears)
    if works and config.adaptation.softens:
        spared = state.spared[0] + (dt / _STIFFENS if _strays(state, dt) else -dt / _FORGIVES)
        state.spared[0] = min(max(spared, 0.0), _SLOWEST)
        softened = state.softened[0]
        if roughest > 1.0:
            softened += dt / _MEAN * math.log(roughest) / _EXPONENT
        elif roughest < _QUIET:
            softened -= dt / _RETURNS
        state.softened[0] = min(max(softened, 0.0), _SLOWEST - state.spared[0])


@inlined
def _strays(state: ControllerState, dt: float) -> bool:
    """Whether a joint is away from its reference by more than noise explains; a ringing joint is not."""
    astray = False
    for j in range(state.measured.size):
        mean, error = state.softness[Softness.ASTRAY, j], state.signals[Signal.POSITION_ERROR, j]
        if math.isfinite(error):
            mean += -math.expm1(-dt / _AVERAGED) * (error - mean)
            state.softness[Softness.ASTRAY, j] = mean
        noise = math.sqrt(state.noise[Noise.LATELY, j])
        astray = astray or abs(mean) > max(_FAR * noise, _FAR_AT_LEAST)
    return astray


@inlined
def write_pace(config: ControllerConfig, state: ControllerState) -> None:
    """Write ``state.pace``: how fast the time of law and observer passes; 1 if the arm is not softened."""
    state.pace[0] = math.exp(-state.softened[0]) if config.adaptation.softens else 1.0
