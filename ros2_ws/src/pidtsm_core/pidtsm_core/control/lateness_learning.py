"""How late the drives are, found while the arm moves.

A bank of hypotheses, each a delay and a lag beyond ``drive.delay`` and ``drive.lag``, is judged by what the observer
finds. With its disturbance d, an acceleration, the model lacks the effort -H d (see lacking.py). If the drives
deliver x_h by hypothesis h, and the observer was given x, then

    -H d + x_h - x

is what friction and errors of the model leave, and nothing else. Per joint, a least-squares fit with exponential
forgetting explains it by Coulomb friction (hard and soft), viscous friction, an inertia and a constant; the hypothesis
is as likely as it leaves little. Everything passes the three poles of the observer, as d has, and two high passes:
lateness shows where the effort changes quickly, errors of the model mostly where it changes slowly. In a quiet motion,
hypotheses of the same sum of delay and lag are alike; ringing, which is what lateness does, tells them apart.

The log likelihood of h is -n/2 times the logarithm of the mean square that is left, summed over the joints; n is the
number of correlation times observed. The drives are taken to be late once the best hypothesis leaves half of what is
left if nothing is late, and is e^5 times as likely besides. Then the controller uses the mean over all hypotheses,
weighted by their probability, except for what every arm bears, and takes it in slowly. Before it can know anything, it
assumes a short delay, which harms no arm that is not late and leaves a late one the time to be recognised. So what is
used is bounded by the largest hypothesis. While the arm does not follow, or touches something, nothing is learnt and
nothing forgotten. Limited efforts are no reason to stop: what was sent is known.

Multiple-model estimation: Magill, "Optimal adaptive estimation of sampled stochastic processes", IEEE Transactions on
Automatic Control 10(4), 1965. The likelihood with an unknown noise: Zellner, "An Introduction to Bayesian Inference in
Econometrics", 1971, chapter 3.
"""

import math
from enum import IntEnum

import numpy as np

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.bank import BANK_DELAYS, BANK_LAGS, FILTERED, HYPOTHESES, NUISANCES, POLES
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.contact import in_contact
from pidtsm_core.control.friction_learning import SOFTER
from pidtsm_core.control.joint_friction import REVERSAL
from pidtsm_core.control.lacking import is_known
from pidtsm_core.control.late_drives import Lateness
from pidtsm_core.control.lateness import lagging
from pidtsm_core.control.state import ControllerState, Count, part
from pidtsm_core.signals import Mode, Signal, Status

_MEMORY = 10.0
"""s in which evidence fades to a third, while the joint moves."""
_FAST = 12.0
"""rad/s; slower changes are not lateness."""
_CORRELATED = 0.1
"""s in which what is left unexplained does not change."""
_PRIOR = 5.0
"""Logarithm of how much more likely it is beforehand that the drives are as late as is assumed now."""
_MISTAKEN = 0.7
"""Logarithm of how much more a hypothesis may explain because the model is wrong elsewhere: half of what is left."""
_TAKEN_IN = 0.1
"""s; time constant of the lateness that is used."""
_NOTHING = 1e-6
"""s; less is nothing."""
_UNKNOWN = 0.7
"""s of motion before which nothing is known."""
_ASSUMED = 0.012
"""s; the delay that is assumed then."""
_BORNE = 0.6
"""Lateness that is left as it is, relative to the inverse of the fastest bandwidth of the observer: the arm bears that,
and friction at a reversal, which is not predicted, disturbs the less the shorter the prediction."""
_SETTLED = 0.99
"""Output of a filter for an input of 1; before, the observer has not found the motion of the arm either."""
_COARSE, _RELATIVE = 0.006, 0.2
"""s, and a share: deviation of the lateness, because the hypotheses are that far apart, and none is a real drive."""
_LEAST = 1e-12
"""Square of the share of the effort limit that is always left unexplained."""
_DELAYS, _LAGS = np.array(BANK_DELAYS), np.array(BANK_LAGS)
_DELAY_OF, _LAG_OF = (np.array(each) for each in zip(*HYPOTHESES, strict=True))


class Nuisance(IntEnum):
    """What the fit explains apart from lateness; its coefficients are in shares of the effort limit per unit."""

    HARD = 0  # tanh(q' / v0)
    SOFT = 1  # tanh(q' / (10 v0))
    VELOCITY = 2  # rad/s
    ACCELERATION = 3  # rad/s^2
    CONSTANT = 4


@part
def learn_lateness(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Update what is known of the lateness after dt (s), from the estimates of this sample, and what is used of it.

    The result is in ``state.lateness``, see `Lateness`.
    """
    _note_efforts(config, state, dt)
    follows = state.status[Status.MODE] == Mode.FOLLOWING and state.status[Status.FAULT] == 0
    learns = follows and not in_contact(config, state)
    state.lateness[Lateness.OBSERVED] += dt if follows else 0.0
    for j in range(state.net.size):
        if not is_known(state, j):
            continue
        _filter(config, state, j, dt)
        settled = state.bank.known[j, POLES - 1, Nuisance.CONSTANT] > _SETTLED
        if learns and settled:
            _weigh(state, j, dt)
    _fit(state, state.counts[Count.ANSWERED] % state.net.size)
    _judge(state)
    _take_in(config, state, dt)


@inlined
def _take_in(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Let what is used follow what was found over dt (s); as long as nothing can be known, it is what does no harm."""
    delay, lag, fastest = 0.0, 0.0, config.adaptation.bandwidth[0]
    for j in range(state.net.size):
        fastest = max(fastest, config.adaptation.bandwidth[j])
    if config.adaptation.uses_lateness and state.lateness[Lateness.LATE] > 0.0:
        delay, lag = state.lateness[Lateness.FOUND_DELAY], state.lateness[Lateness.FOUND_LAG]
        borne = _BORNE / fastest
        share = 1.0 - borne / max(delay + lag, borne)
        delay, lag = share * delay, share * lag
    elif config.adaptation.uses_lateness and state.lateness[Lateness.OBSERVED] < _UNKNOWN:
        delay = _ASSUMED
    pace = -math.expm1(-dt / _TAKEN_IN)
    for place, wanted in ((Lateness.DELAY, delay), (Lateness.LAG, lag)):
        used = state.lateness[place] + pace * (wanted - state.lateness[place])
        state.lateness[place] = used if used > _NOTHING else 0.0


def forget_lateness(state: ControllerState) -> None:
    """Begin anew: what was found was beyond other parameters."""
    bank = state.bank
    for array in (state.lateness, bank.normal, bank.mixed, bank.squares, bank.evidence, bank.left):
        array[:] = 0.0


@inlined
def _note_efforts(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Note what the drives deliver for the last command with each lag, and find the rows of each delay."""
    newest = int(state.under_way_newest[0])
    for i in range(_LAGS.size):
        for j in range(state.net.size):
            sent, lag = state.commanded[j], config.drive.lag[j] + _LAGS[i]
            mean, last = lagging(state.bank.drives[i, j] - sent, lag, dt)
            state.bank.efforts[newest, i, j] = sent + mean
            state.bank.drives[i, j] = sent + last
    age, back = 0.0, 0
    for i in range(_DELAYS.size):
        acts = config.drive.delay + _DELAYS[i]
        row = (newest - back) % state.under_way_held.size
        while age + state.under_way_held[row] <= acts and back < state.under_way_held.size - 1:
            age += state.under_way_held[row]
            back += 1
            row = (newest - back) % state.under_way_held.size
        state.bank.rows[i] = row


@inlined
def _filter(config: ControllerConfig, state: ControllerState, j: int, dt: float) -> None:
    """Filter the inputs of joint j like the observer, add what is lacking, and remove what is slow."""
    known, left = state.bank.known[j], state.bank.filters[j]
    bandwidth, limit = state.pace[0] * config.adaptation.bandwidth[j], config.limits.effort[j]
    gone, slow = -math.expm1(-bandwidth * dt), -math.expm1(-_FAST * dt)
    velocity = state.learnt_velocity[j]
    for k in range(NUISANCES):
        value = 1.0
        if k == Nuisance.HARD:
            value = math.tanh(velocity / REVERSAL)
        elif k == Nuisance.SOFT:
            value = math.tanh(velocity / (SOFTER * REVERSAL))
        elif k == Nuisance.VELOCITY:
            value = velocity
        elif k == Nuisance.ACCELERATION:
            value = state.signals[Signal.ACCELERATION, j]
        for pole in range(POLES):
            known[pole, k] += gone * (value - known[pole, k])
            value = known[pole, k]
        for pole in range(POLES, FILTERED):
            known[pole, k] += slow * (value - known[pole, k])
            value -= known[pole, k]
        known[FILTERED, k] = value
    given = state.applied[j] if config.feeds_back else state.delivered[j]
    for h in range(_DELAY_OF.size):
        value = state.bank.efforts[state.bank.rows[_DELAY_OF[h]], _LAG_OF[h], j] - given
        for pole in range(POLES):
            left[pole, h] += gone * (value - left[pole, h])
            value = left[pole, h]
        value = (value + state.lacking[j]) / limit
        for pole in range(POLES, FILTERED):
            left[pole, h] += slow * (value - left[pole, h])
            value -= left[pole, h]
        left[FILTERED, h] = value


@inlined
def _weigh(state: ControllerState, j: int, dt: float) -> None:
    """Add dt (s) of evidence to the normal equations of joint j, and forget a little of what was before."""
    known, left = state.bank.known[j, FILTERED], state.bank.filters[j, FILTERED]
    normal, mixed, squares = state.bank.normal[j], state.bank.mixed[j], state.bank.squares[j]
    kept = math.exp(-dt / _MEMORY)
    for a in range(NUISANCES):
        for b in range(a + 1):
            normal[a, b] = kept * normal[a, b] + dt * known[a] * known[b]
        share = dt * known[a]
        for h in range(left.size):
            mixed[a, h] = kept * mixed[a, h] + share * left[h]
    for h in range(left.size):
        squares[h] = kept * squares[h] + dt * left[h] * left[h]
    state.bank.evidence[j] = kept * state.bank.evidence[j] + dt


@inlined
def _fit(state: ControllerState, j: int) -> None:
    """Write the logarithm of what each hypothesis leaves unexplained of joint j, by Cholesky's decomposition."""
    normal, mixed, solved, factor = state.bank.normal[j], state.bank.mixed[j], state.bank.solved, state.bank.factor
    evidence = state.bank.evidence[j]
    if evidence == 0.0:
        return
    trace = 0.0
    for a in range(NUISANCES):
        trace += normal[a, a]
    least = 1e-6 * trace + _LEAST
    left = state.bank.left[j]
    for h in range(left.size):
        left[h] = state.bank.squares[j, h]
    for a in range(NUISANCES):
        for b in range(a + 1):
            rest = normal[a, b]
            for c in range(b):
                rest -= factor[a, c] * factor[b, c]
            factor[a, b] = math.sqrt(max(rest + least, least)) if a == b else rest / factor[b, b]
        for h in range(left.size):
            solved[a, h] = mixed[a, h]
        for b in range(a):
            for h in range(left.size):
                solved[a, h] -= factor[a, b] * solved[b, h]
        for h in range(left.size):
            solved[a, h] /= factor[a, a]
            left[h] -= solved[a, h] * solved[a, h]
    for h in range(left.size):
        left[h] = math.log(max(left[h], 0.0) + _LEAST * evidence)


@inlined
def _judge(state: ControllerState) -> None:
    """Decide whether the drives are late; write mean and deviation of the lateness, weighted by the probabilities."""
    likely, left, best, margin = state.bank.solved[0], state.bank.left, 0, _PRIOR
    for h in range(likely.size):
        likely[h] = 0.0
        for j in range(state.net.size):
            likely[h] -= 0.5 * state.bank.evidence[j] / _CORRELATED * left[j, h]
        if likely[h] > likely[best]:
            best = h
    for j in range(state.net.size):
        margin += 0.5 * state.bank.evidence[j] / _CORRELATED * _MISTAKEN
    if likely[best] - likely[0] > margin:
        state.lateness[Lateness.LATE] = 1.0
    weight = delay = lag = squares = 0.0
    for h in range(likely.size):
        probability = math.exp(likely[h] - likely[best])
        d, t = _DELAYS[_DELAY_OF[h]], _LAGS[_LAG_OF[h]]
        weight += probability
        delay += probability * d
        lag += probability * t
        squares += probability * (d + t) * (d + t)
    delay, lag = delay / weight, lag / weight
    state.lateness[Lateness.FOUND_DELAY], state.lateness[Lateness.FOUND_LAG] = delay, lag
    total = delay + lag
    variance = max(squares / weight - total * total, 0.0) + _COARSE * _COARSE + _RELATIVE * total * _RELATIVE * total
    state.lateness[Lateness.DEVIATION] = math.sqrt(variance)
