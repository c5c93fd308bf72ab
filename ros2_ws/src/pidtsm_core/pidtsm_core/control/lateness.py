"""Drives and busses that are late: what acts now was commanded before, and what is commanded now acts later.

``drive.delay`` D passes from the stamp of a position until the command that answers it acts; the drive of a joint then
follows its command like a first-order lag T (``drive.lag``). Three things make up for it:

* *What acts.* A model of the drives, x' = (u - x) / T, tells the effort that they deliver. The observer gets what they
  deliver now, of commands older by D, instead of the last command.
* *Prediction.* At D after the stamp, the arm will be at q + D q' + D^2 d / 2 plus what the efforts that are under way
  do to it: their accelerations, by the model, and the observer's disturbance d are integrated twice. The model includes
  the viscous friction beyond what compensates it at the desired velocity: over the delay, it damps a light joint much.
  If the disturbance is rejected, so is this part of it. The law sees this motion, and the reference at that time.
* *Inversion.* The command is x + r (u - x), where u is what the law demands. The drives then follow u with the time
  constant T / r. The ratio r is ``drive.inversion``: it is also how much quick changes, and noise, are amplified.

The inversion is the last stage before the drives: the controller's limits, its safe effort and its changes from one to
the other are about u. While no joint state arrives, nothing is inverted.

Prediction for a delayed input: Artstein, "Linear systems with delayed controls: a reduction", IEEE Transactions on
Automatic Control 27(4), 1982. The bound of what a wrong delay may do: Krstic, "Delay compensation for nonlinear,
adaptive, and PDE systems", 2009, chapter 4.
"""

import math

from pidtsm_core.compiling.decorators import inlined
from pidtsm_core.control.bank import MOST_UNDER_WAY
from pidtsm_core.control.configuration import ControllerConfig
from pidtsm_core.control.late_drives import Lateness, Predicted, UnderWay
from pidtsm_core.control.state import Condition, ControllerState, Count, part
from pidtsm_core.estimators import DISTURBANCE
from pidtsm_core.references import extrapolate
from pidtsm_core.robots import forward_dynamics
from pidtsm_core.signals import Signal

LATEST_FOR_FREEDRIVE = 0.018
"""s; in freedrive, the drives must not be later than this: they would answer the hand too late."""
_LONG = 1.0
"""s; longer than any delay."""


@inlined
def delay_of(config: ControllerConfig, state: ControllerState) -> float:
    """The delay of the drives, as far as it is known or was learnt, s."""
    return config.drive.delay + state.lateness[Lateness.DELAY]


@inlined
def lag_of(config: ControllerConfig, state: ControllerState, joint: int) -> float:
    """Likewise their lag."""
    return config.drive.lag[joint] + state.lateness[Lateness.LAG]


@inlined
def remaining(config: ControllerConfig, state: ControllerState) -> float:
    """Delay of the drives, and what the inversion leaves of the longest lag, s."""
    left = 0.0
    for j in range(state.sent.size):
        left = max(left, lag_of(config, state, j) / config.drive.inversion[j])
    return delay_of(config, state) + left


@inlined
def lagging(behind: float, lag: float, dt: float) -> tuple[float, float]:
    """How far a drive is behind a command on average over dt (s), and at its end, if it was `behind` (N m) at first."""
    if lag <= 0.0:
        return 0.0, 0.0
    ratio = dt / lag
    return behind * -math.expm1(-ratio) / ratio, behind * math.exp(-ratio)


@part
def deliver(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Write what the drives have delivered since the last tick, dt (s) ago, to ``state.net`` and ``state.delivered``.

    The command of the last tick becomes the newest one under way.
    """
    rows, predicted, acceleration, joints = state.under_way, state.predicted, state.scratch[0], state.net.size
    newest = int(state.under_way_newest[0] + 1) % MOST_UNDER_WAY
    for j in range(joints):
        sent = state.commanded[j]
        mean, last = lagging(state.drive[j] - sent, lag_of(config, state, j), dt)
        mean += sent
        state.drive[j] = sent + last
        rows[newest, UnderWay.EFFORT, j] = mean
        rows[newest, UnderWay.ADDED, j] = state.added[j]
        state.net[j] = (
            mean - state.added[j] + _damping(config, state, j, predicted[Predicted.VELOCITY, j], state.ahead[1, j])
        )
    # The arm will be where it is predicted to be when they act.
    forward_dynamics(
        config.model, predicted[Predicted.POSITION], predicted[Predicted.VELOCITY], state.net, acceleration
    )
    for j in range(joints):
        rows[newest, UnderWay.ACCELERATION, j] = acceleration[j] if math.isfinite(acceleration[j]) else 0.0
    state.under_way_newest[0] = newest
    state.under_way_held[newest] = dt
    _write_acting(config, state, dt)


@inlined
def _write_acting(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Average what acted over the last dt (s): the efforts of commands that are older by the delay."""
    rows, delivered, net = state.under_way, state.delivered, state.net
    for j in range(net.size):
        delivered[j] = net[j] = 0.0
    age, first = 0.0, delay_of(config, state)
    last = first + dt
    for back in range(MOST_UNDER_WAY):
        i = (int(state.under_way_newest[0]) - back) % MOST_UNDER_WAY
        begin = age
        age += state.under_way_held[i]
        share = (min(age, last) - max(begin, first)) / dt
        if share > 0.0:
            for j in range(net.size):
                delivered[j] += share * rows[i, UnderWay.EFFORT, j]
                net[j] -= share * rows[i, UnderWay.ADDED, j]
        if age >= last:
            break
    for j in range(net.size):
        net[j] += state.applied[j] if config.feeds_back else delivered[j]
        state.damped[j] = _damping(config, state, j, state.signals[Signal.VELOCITY, j], state.desired[1, j])
        net[j] += state.damped[j]


@inlined
def _damping(config: ControllerConfig, state: ControllerState, joint: int, velocity: float, desired: float) -> float:
    """Viscous friction beyond what compensates it at the desired velocity (both rad/s), N m; 0 without a delay."""
    predicts = config.compensates and delay_of(config, state) > 0.0
    return config.compensation.viscous[joint] * (desired - velocity) if predicts else 0.0


@part
def predict(config: ControllerConfig, state: ControllerState) -> None:
    """Write the motion after the delay to ``state.predicted``, and the desired one to ``state.ahead``."""
    y, rows, predicted, delay = state.signals, state.under_way, state.predicted, delay_of(config, state)
    newest = int(state.under_way_newest[0])
    for j in range(predicted.shape[1]):
        d = state.estimator[j, DISTURBANCE]
        predicted[Predicted.POSITION, j] = y[Signal.POSITION, j] + delay * (y[Signal.VELOCITY, j] + 0.5 * delay * d)
        predicted[Predicted.VELOCITY, j] = y[Signal.VELOCITY, j] + delay * d
        predicted[Predicted.ACCELERATION, j] = y[Signal.ACCELERATION, j]
        if delay > 0.0:
            predicted[Predicted.ACCELERATION, j] = rows[newest, UnderWay.ACCELERATION, j] + d
    age = 0.0
    for back in range(MOST_UNDER_WAY):
        if age >= delay:
            break
        i = (newest - back) % MOST_UNDER_WAY
        begin, age = age, min(age + state.under_way_held[i], delay)
        for j in range(predicted.shape[1]):
            acceleration = rows[i, UnderWay.ACCELERATION, j]
            predicted[Predicted.POSITION, j] += 0.5 * (age * age - begin * begin) * acceleration
            predicted[Predicted.VELOCITY, j] += (age - begin) * acceleration
    extrapolate(state.desired, delay, state.ahead)
    for j in range(predicted.shape[1]):
        damping = _damping(config, state, j, predicted[Predicted.VELOCITY, j], state.ahead[1, j])
        state.undamped[j] = -damping if config.rejects else 0.0


@part
def command_drives(config: ControllerConfig, state: ControllerState, dt: float) -> None:
    """Write the commands with which the drives deliver ``state.sent`` sooner to ``state.commanded`` and ``output``.

    They keep within the limits of effort and rate.

    Args:
        config: configuration, which is read.
        state: state, which is changed.
        dt: time since the last command, s; 0: what the drives deliver is not known, so nothing is inverted. Before the
            first joint state is answered, they are assumed to deliver what keeps the arm at rest.
    """
    if state.counts[Count.ANSWERED] == 0:
        _begin_at_rest(state)
    for j in range(state.sent.size):
        demanded, limit = state.sent[j], config.limits.effort[j]
        command, lag = demanded, lag_of(config, state, j)
        if lag > 0.0 and dt > 0.0:
            # Over one period, a drive can reach what is demanded, but must not overshoot.
            ratio = min(config.drive.inversion[j], -1.0 / math.expm1(-dt / lag))
            command = state.drive[j] + ratio * (demanded - state.drive[j])
        change = config.limits.effort_rate[j] * dt
        if change > 0.0 and state.conditions[Condition.UNLIMITED] == 0:
            command = min(max(command, state.commanded[j] - change), state.commanded[j] + change)
        state.commanded[j] = state.output[j] = min(max(command, -limit), limit)


@inlined
def _begin_at_rest(state: ControllerState) -> None:
    """Assume that the effort of the first tick has acted for long."""
    state.under_way_held[:] = 0.0
    newest = int(state.under_way_newest[0])
    state.under_way_held[newest] = _LONG
    for j in range(state.drive.size):
        effort = state.sent[j]
        state.drive[j] = state.delivered[j] = effort
        for i in range(state.bank.drives.shape[0]):
            state.bank.drives[i, j] = state.bank.efforts[newest, i, j] = effort
        state.under_way[newest, UnderWay.EFFORT, j] = effort
        state.under_way[newest, UnderWay.ADDED, j] = state.added[j]
        state.under_way[newest, UnderWay.ACCELERATION, j] = 0.0


def refusal_of_freedrive(config: ControllerConfig, state: ControllerState) -> str:
    """Why the drives are too late for freedrive; empty if they are not."""
    late = remaining(config, state)
    if late <= LATEST_FOR_FREEDRIVE:
        return ""
    return (
        f"the drives answer a hand {1e3 * late:.0f} ms late (drive.delay + drive.lag / drive.inversion), and freedrive "
        f"needs {1e3 * LATEST_FOR_FREEDRIVE:.0f} ms at most"
    )


def begin_lateness(state: ControllerState) -> None:
    """Begin to make up for late drives while the arm moves: what was sent last is assumed to have acted for long."""
    newest = int(state.under_way_newest[0])
    state.under_way_held[:] = 0.0
    state.under_way_held[newest] = _LONG
    state.drive[:] = state.delivered[:] = state.commanded[:] = state.sent
    state.bank.drives[:] = state.bank.efforts[newest] = state.sent
    state.under_way[newest, UnderWay.EFFORT] = state.sent
    state.under_way[newest, UnderWay.ADDED] = state.added
    state.under_way[newest, UnderWay.ACCELERATION] = (
        state.signals[Signal.ACCELERATION] - state.estimator[: state.sent.size, DISTURBANCE]
    )
    state.predicted[:] = state.signals[: Signal.POSITION_ERROR]
    state.ahead[:] = state.desired
