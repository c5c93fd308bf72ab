"""Friction that the controller does not compensate yet, found while the arm moves.

With the disturbance d of the observer, the model lacks the effort -H d, see lacking.py. Friction is the part of it
that changes its sign with the velocity. Per joint, a recursive least-squares fit with exponential forgetting explains
what is lacking by

    hard tanh(q' / v0) + middle tanh(q' / (3 v0)) + soft tanh(q' / (10 v0))
    + viscous q' + constant + stiffness q_d + inertia q_d''

The first three are Coulomb friction, which is there at once or within some tenths of a radian per second; only they are
compensated, in the shape that was found. The last three stand for a payload and for errors of the model, which must not
be taken for friction, and the lag of a drive looks like viscous friction. For the same reason everything is
high-passed: a payload that is picked up is slow against a reversal of friction. The regressors pass the three poles of
the observer first, as what it finds has passed them. So does what compensates Coulomb friction already, which is added
to what is lacking: the fit finds the whole friction, whose sign follows the true velocity, and not an error of a
compensation that follows the desired one.

At a reversal the disturbance changes quickly, and the observer's velocity is wrong; see lacking.py for its correction.

The fit estimates its own uncertainty from the slow part of what it leaves unexplained: noise, and the vibration of
motors that stick and slip, average out. The controller compensates the estimate minus its standard deviation, so it
changes nothing on an arm without friction, or where the data are inconclusive. Samples that the fit cannot explain, as
when a payload is picked up, count for less; those of a noisy velocity not at all. The
compensation follows the reference's velocity, which is free of noise, and is bounded, so the closed loop sees a bounded
and slowly changing feedforward. While the arm does not follow, touches something, is held back or rests, nothing is
learnt and nothing forgotten.

Weights of unusual samples: Huber, "Robust estimation of a location parameter", Annals of Mathematical Statistics
35(1), 1964.
Recursive least squares with forgetting: Astrom and Wittenmark, "Adaptive Control", 2nd edition, 1995, chapter 2.
Learning friction from a disturbance observer: Le Tien, Albu-Schaeffer, De Luca and Hirzinger, "Friction observer and
compensation for control of robots with joint torque measurement", IROS 2008.
"""

import math
from enum import IntEnum

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.contact import in_contact
from pidtsm_core.control.effort import held_back
from pidtsm_core.control.joint_friction import REVERSAL, coulomb_friction
from pidtsm_core.control.lacking import is_known, is_noisy
from pidtsm_core.control.state import FITTED, ControllerState, Friction, part
from pidtsm_core.signals import Mode, Status

_MEMORY = 4.0
"""s in which evidence fades to a third, while the joint moves."""
_SLOW = 1.0
"""rad/s; slower changes are not friction."""
_CORRELATED = 0.4
"""s; time constant of the low pass that lets the slow part of what is left unexplained through."""
_DENSITY = 3.0
"""Spectral density of what is left, relative to its slow part's mean square times that: 2 if it changes much faster, 4
if it changes as slowly. With it, 95 % intervals hold 97 % of the friction of 200 simulated arms."""
_CAUTION, _CAUTION_BELOW = 1.0, 2.0
"""Standard deviations that are not compensated; and that do not count where there seems to be less friction than the
parameters promise."""
_BOTH_WAYS = 0.5
"""s of evidence of each direction, before which less friction than promised is not certain: of motion in one direction,
the fit takes a part of it for something else, such as a payload."""
_TAKEN_IN, _TAKEN_BACK = 0.7, 0.1
"""s; time constants of the compensated friction while it grows, and while it shrinks: a short push must not pass for
friction, but what is too much does harm."""
MIDDLE, SOFTER = 3.0, 10.0
"""How much faster a joint must move until the other parts of its friction are there."""
_UNUSUAL = 3.0
"""Standard deviations of what is left unexplained, beyond which a sample counts for less."""
_LONG = 1.0
"""s of evidence, before which every sample counts."""
_LARGEST = 0.35
"""Largest compensated friction, a share of the effort limit."""
_RESTS = 0.1
"""Filtered sign of the velocity below which the motion of a joint shows nothing of its friction: it rests, or has moved
in one direction for long."""
_SETTLED = 0.99
"""Output of a filter for an input of 1; before, the observer has not found the motion of the arm either."""


class Regressor(IntEnum):
    """What the fit explains the lacking effort by; its coefficients are in N m per unit."""

    HARD = 0  # tanh(q' / v0)
    MIDDLE = 1  # tanh(q' / (3 v0))
    SOFT = 2  # tanh(q' / (10 v0))
    VELOCITY = 3  # rad/s
    CONSTANT = 4
    POSITION = 5  # rad
    ACCELERATION = 6  # rad/s^2


_PRIOR = (2e-3, 2e-3, 2e-3, 2e-2, 2e-4, 2e-3, 2e-3)
"""Evidence (s) for the promised friction, and for no other effort, so that there is always a solution."""
_INPUTS = len(Regressor) + 1
"""Filtered together: the regressors, and the compensated effort (afterwards: what the model lacks)."""
_POLES = 3


@part
def learn_friction(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Update what is known of the friction after dt (s), from what `find_lacking` has found, and what is compensated.

    The result is in ``state.friction``, see `Friction`.
    """
    follows = state.status[Status.MODE] == Mode.FOLLOWING and state.status[Status.FAULT] == 0
    learns = follows and not in_contact(config, state)
    for j in range(state.lacking.size):
        if not is_known(state, j):
            continue
        _filter(config, state, j, dt)
        moves = abs(state.friction_inputs[_POLES + 1, j * _INPUTS + Regressor.HARD]) > _RESTS
        settled = state.friction_inputs[_POLES - 1, j * _INPUTS + Regressor.CONSTANT] > _SETTLED
        if learns and moves and settled and not held_back(config, state, j):
            _weigh(state, j, dt)
            fit_friction(config, state, j)
        _take_in(config, state, j, dt)


def forget_friction(state: ControllerState) -> None:
    """Begin anew: what was found was beyond another ``compensation``."""
    state.friction[:] = 0.0
    state.friction_evidence[:] = 0.0
    state.friction_fit[:] = 0.0


@inlined
def _filter(config: ControllerConfig, state: ControllerState, j: int, dt: float) -> None:
    """Filter the regressors of joint j like the observer, add what is lacking, and remove what is slow.

    The result is in the last row of ``state.friction_inputs``.
    """
    rows, first = state.friction_inputs, j * _INPUTS
    gone = -math.expm1(-state.pace[0] * config.adaptation.bandwidth[j] * dt)
    slow = -math.expm1(-_SLOW * dt)
    velocity = state.desired[1, j] if is_noisy(config, state, j, dt) else state.learnt_velocity[j]
    compensated = acting_compensation(config, state, j)
    for k in range(_INPUTS):
        value = compensated
        if k == Regressor.HARD:
            value = math.tanh(velocity / REVERSAL)
        elif k == Regressor.MIDDLE:
            value = math.tanh(velocity / (MIDDLE * REVERSAL))
        elif k == Regressor.SOFT:
            value = math.tanh(velocity / (SOFTER * REVERSAL))
        elif k == Regressor.VELOCITY:
            value = velocity
        elif k == Regressor.CONSTANT:
            value = 1.0
        elif k == Regressor.POSITION:
            value = state.desired[0, j]
        elif k == Regressor.ACCELERATION:
            value = state.desired[2, j]
        for pole in range(_POLES):
            rows[pole, first + k] += gone * (value - rows[pole, first + k])
            value = rows[pole, first + k]
        if k == _INPUTS - 1:
            value += state.lacking[j]
        rows[_POLES, first + k] += slow * (value - rows[_POLES, first + k])
        rows[_POLES + 1, first + k] = value - rows[_POLES, first + k]


@inlined
def _weigh(state: ControllerState, j: int, dt: float) -> None:
    """Add dt (s) of evidence to the normal equations of joint j, and forget a little of what was before."""
    known, found = state.friction_evidence, state.friction
    inputs, first, row = state.friction_inputs[_POLES + 1], j * _INPUTS, j * FITTED
    kept = math.exp(-dt / _MEMORY)
    lacking = inputs[first + FITTED]
    left = _left(state, j, lacking)
    new = dt * _weight(state, j, left)
    for a in range(FITTED):
        for b in range(FITTED):
            known[row + a, b] = kept * known[row + a, b] + new * inputs[first + a] * inputs[first + b]
        known[row + a, FITTED] = kept * known[row + a, FITTED] + new * inputs[first + a] * lacking
    found[Friction.SQUARES, j] = kept * found[Friction.SQUARES, j] + new * lacking * lacking
    direction = state.friction_inputs[_POLES - 1, first + Regressor.HARD]
    found[Friction.FORTH, j] = kept * found[Friction.FORTH, j] + new * max(direction, 0.0)
    found[Friction.BACK, j] = kept * found[Friction.BACK, j] + new * max(-direction, 0.0)
    found[Friction.LEFT, j] += -math.expm1(-dt / _CORRELATED) * (left - found[Friction.LEFT, j])
    found[Friction.SLOW, j] = kept * found[Friction.SLOW, j] + new * found[Friction.LEFT, j] ** 2
    found[Friction.EVIDENCE, j] = kept * found[Friction.EVIDENCE, j] + new


@inlined
def _left(state: ControllerState, j: int, lacking: float) -> float:
    """What the fit leaves unexplained of the effort that joint j lacks, N m."""
    fit, inputs, first = state.friction_fit[j], state.friction_inputs[_POLES + 1], j * _INPUTS
    for a in range(FITTED):
        lacking -= fit[a] * inputs[first + a]
    return lacking


@inlined
def _weight(state: ControllerState, j: int, left: float) -> float:
    """Weight of a sample of joint j: less than 1 if the fit leaves much of it unexplained, N m (Huber)."""
    usual = _UNUSUAL * state.friction_fit[j, FITTED]
    return usual / abs(left) if 0.0 < usual < abs(left) else 1.0


@inlined
def fit_friction(config: ControllerConfig, state: ControllerState, j: int) -> None:
    """Write what the evidence says about the friction of joint j beyond ``compensation``, and its deviation."""
    _fit(state, j, config.compensation.coulomb[j])
    known = state.friction
    known[Friction.COULOMB, j] -= config.compensation.coulomb[j]
    if min(known[Friction.FORTH, j], known[Friction.BACK, j]) < _BOTH_WAYS:
        known[Friction.DEVIATION, j] = max(known[Friction.DEVIATION, j], -known[Friction.COULOMB, j])


@inlined
def _fit(state: ControllerState, j: int, promised: float) -> None:
    """Solve the normal equations of joint j by Cholesky's decomposition; write friction and its deviation.

    As long as there is no evidence, the friction is the `promised` one, N m.
    """
    known, solution, found, row = state.friction_evidence, state.friction_solution, state.friction, j * FITTED
    factor, right = solution[:FITTED], solution[FITTED:]
    for a in range(FITTED):
        for b in range(a + 1):
            rest = known[row + a, b]
            for c in range(b):
                rest -= factor[a, c] * factor[b, c]
            if a == b:
                factor[a, a] = math.sqrt(max(rest + _PRIOR[a], _PRIOR[a]))
            else:
                factor[a, b] = rest / factor[b, b]
        expected = promised if a == Regressor.HARD else 0.0
        right[0, a] = known[row + a, FITTED] + _PRIOR[a] * expected
        right[1, a] = 1.0 if a <= Regressor.SOFT else 0.0
    unexplained = found[Friction.SQUARES, j]
    for k in range(2):
        _substitute(factor, right[k])
    for a in range(FITTED):
        expected = promised if a == Regressor.HARD else 0.0
        unexplained -= right[0, a] * (known[row + a, FITTED] + _PRIOR[a] * (right[0, a] - expected))
    variance = _DENSITY * _CORRELATED * found[Friction.SLOW, j] / found[Friction.EVIDENCE, j]
    middle, soft = right[0, Regressor.MIDDLE], right[0, Regressor.SOFT]
    found[Friction.COULOMB, j] = right[0, Regressor.HARD] + middle + soft
    found[Friction.MIDDLE, j], found[Friction.SOFT, j] = middle, soft
    for a in range(FITTED):
        state.friction_fit[j, a] = right[0, a]
    if found[Friction.EVIDENCE, j] > _LONG:
        state.friction_fit[j, FITTED] = math.sqrt(max(unexplained, 0.0) / found[Friction.EVIDENCE, j])
    found[Friction.VISCOUS, j] = right[0, Regressor.VELOCITY]
    spread = right[1, Regressor.HARD] + right[1, Regressor.MIDDLE] + right[1, Regressor.SOFT]
    found[Friction.DEVIATION, j] = math.sqrt(variance * max(spread, 0.0))


@inlined
def _substitute(factor: Array, x: Array) -> None:
    """Solve factor factor^T x = x in place; `factor` is lower triangular, shape (FITTED, FITTED)."""
    for a in range(FITTED):
        for b in range(a):
            x[a] -= factor[a, b] * x[b]
        x[a] /= factor[a, a]
    for i in range(FITTED):
        a = FITTED - 1 - i
        for b in range(a + 1, FITTED):
            x[a] -= factor[b, a] * x[b]
        x[a] /= factor[a, a]


@inlined
def _take_in(config: ControllerConfig, state: ControllerState, j: int, dt: float) -> None:
    """Let the compensated friction of joint j follow what is certain, and write its effort for the desired velocity."""
    known, most = state.friction, _LARGEST * config.limits.effort[j]
    found, used = known[Friction.COULOMB, j], 0.0
    if config.adaptation.compensates_friction:
        # What the parameters compensate may be too much, but friction is never negative.
        caution = _CAUTION if found > 0.0 else _CAUTION_BELOW
        certain = max(abs(found) - caution * known[Friction.DEVIATION, j], 0.0)
        used = max(math.copysign(min(certain, most), found), -config.compensation.coulomb[j])
    promised = config.compensation.coulomb[j]
    grows = abs(promised + used) > abs(promised + known[Friction.USED, j])
    pace = -math.expm1(-dt / (_TAKEN_IN if grows else _TAKEN_BACK))
    known[Friction.USED, j] += pace * (used - known[Friction.USED, j])
    middle = min(max(known[Friction.MIDDLE, j] / found, 0.0), 1.0) if found != 0.0 else 0.0
    soft = min(max(known[Friction.SOFT, j] / found, 0.0), 1.0 - middle) if found != 0.0 else 0.0
    known[Friction.MIDDLE_SHARE, j] += pace * (middle - known[Friction.MIDDLE_SHARE, j])
    known[Friction.SOFT_SHARE, j] += pace * (soft - known[Friction.SOFT_SHARE, j])
    known[Friction.EFFORT, j] = _compensation(state, j, state.ahead[1, j] if config.drive.late else state.desired[1, j])


@inlined
def acting_compensation(config: ControllerConfig, state: ControllerState, j: int) -> float:
    """What compensates the Coulomb friction of joint j over the last period, N m, less what the observer was told."""
    compensated = state.friction[Friction.EFFORT, j]
    if config.drive.late:  # What acts now was added for this velocity.
        compensated = _compensation(state, j, state.desired[1, j]) - state.damped[j]
    if config.presses:
        compensated += state.pressed[j]
    return compensated + coulomb_friction(config, state.desired[1, j], j)


@inlined
def _compensation(state: ControllerState, j: int, velocity: float) -> float:
    """What compensates the friction of joint j at a desired velocity (rad/s), N m."""
    v, known = velocity / REVERSAL, state.friction
    middle, soft = known[Friction.MIDDLE_SHARE, j], known[Friction.SOFT_SHARE, j]
    shape = (1.0 - middle - soft) * math.tanh(v) + middle * math.tanh(v / MIDDLE) + soft * math.tanh(v / SOFTER)
    return known[Friction.USED, j] * shape
