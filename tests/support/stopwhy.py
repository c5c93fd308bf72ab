"""Why a stop is bad: which condition must go, so that it is good?

A bad stop is simulated again from the sample of the stop on, each time without one of the conditions in `CONDITIONS`,
and judged as before. The first condition without which the stop is good explains it (a counterfactual, "but for"); then
those in `CHOICES`. Before all that, the best braking takes the place of the controller: it knows the true arm and its
true motion without delay, and only the limits of torques and of their steps bind it. If it is bad, too, no controller
could have done better: ``limits``. A condition that a case does not have is not tried. What is allowed remains that of
the stop as it was: of its motion, its torque limits and its rate.

If no single condition explains the stop, more are taken away one after the other, each time the one without which the
stop is best, until it is good, or all of them but one; then those are given back that are not needed for it. If this
leads nowhere, all pairs and triples are tried. What is left is the controller's own: ``controller``.
"""

from collections.abc import Callable, Iterable
from itertools import combinations

import numpy as np

from pidtsm_core.control import Condition, Count, Time
from pidtsm_core.control.state import HISTORY, Held, Hold, Still
from pidtsm_core.robots import Model, inverse_dynamics
from pidtsm_core.signals import Signal, Status, Stop
from support.stopjudge import Outcome, gravity, judge
from support.stoploop import Kind, stop_ideally
from support.stoprun import Run

Change = Callable[[Run], None]
_FAST = 1000
"""Hz."""
_USUAL = 2.5
"""rad/s or m/s; velocity limit of an arm that has none."""
_SOON = 0.05
"""s; a load that is picked up so soon after the stop counts as picked up."""


def _end(run: Run, *kinds: Kind) -> None:
    table = run.events.table
    for kind in kinds:
        rows = table[:, 0] == kind
        table[rows, 3] = np.minimum(table[rows, 3], run.stopped + 1)


def _outage(run: Run) -> None:
    _end(run, Kind.LOSS)


def _lie(run: Run) -> None:
    _end(run, Kind.OFF, Kind.MIRRORED, Kind.NEGATED, Kind.FROZEN)
    _believe(run)


def _believe(run: Run) -> None:
    state = run.controller.state
    state.hold[Hold.DISTRUSTED : Hold.REVERSED + 1] = 0.0
    state.still[Still.SAMPLES] = 0.0


def _push(run: Run) -> None:
    _end(run, Kind.PUSH)


def _begin(run: Run) -> None:
    """The stop begins with the true motion, at the next sample."""
    state, k, trace = run.controller.state, run.stopped, run.trace
    state.signals[Signal.POSITION], state.signals[Signal.VELOCITY] = trace.position[k], trace.velocity[k]
    state.measured[:] = trace.position[k]
    state.hold[Hold.BEFORE] = trace.velocity[k]
    first = max(state.counts[Count.NOTES] - HISTORY, 0)
    for note in range(first, state.counts[Count.NOTES]):
        row = note % HISTORY
        age = (state.times[Time.LAST] - state.history_stamps[row]) / 1e9
        state.history[row] = trace.position[max(k - round(age / run.dt), 0)]
    _believe(run)
    _again(run)


def _again(run: Run) -> None:
    """The stop begins again at the next sample."""
    state = run.controller.state
    state.conditions[Condition.HELD] = Held.ELSEWHERE
    state.hold[Hold.INTEGRAL] = state.implausible[:] = 0.0
    state.status[Status.STOP_STAGE] = Stop.HOLD


def _sensors(run: Run) -> None:
    hardware = run.parts.hardware
    sensor, channel = hardware.sensor._replace(ideal=True), hardware.measurements._replace(direct=True)
    run.parts = run.parts._replace(hardware=hardware._replace(sensor=sensor, measurements=channel))


def _drives(run: Run) -> None:
    hardware = run.parts.hardware
    drives, channel = hardware.actuator._replace(ideal=True), hardware.commands._replace(direct=True)
    run.parts = run.parts._replace(hardware=hardware._replace(actuator=drives, commands=channel))


def _friction(run: Run) -> None:
    hardware = run.parts.hardware
    plant = hardware.plant._replace(friction=hardware.plant.friction._replace(none=True))
    run.parts = run.parts._replace(hardware=hardware._replace(plant=plant))


def _carried(run: Run) -> Model:
    """The true arm, with what it will pick up soon."""
    return run.true(run.stopped + round(_SOON / run.dt))


def _load(run: Run) -> None:
    """The hold knows what carries the true arm."""
    q = run.trace.position[run.stopped]
    known, carried = run.controller.config.model, _carried(run)
    run.controller.state.hold[Hold.LEARNT] = gravity(carried, q) - gravity(known, q)
    run.controller.state.hold[Hold.INTEGRAL] = 0.0


def _model(run: Run) -> None:
    """The controller knows the true arm."""
    model = run.controller.config.model.parameters
    model[:] = _carried(run).parameters
    run.controller.state.hold[Hold.LEARNT] = 0.0
    _again(run)


def _rate_limit(run: Run) -> None:
    run.controller.config.limits.effort_rate[:] = 0.0


def _speed(run: Run) -> None:
    """The arm is no faster than its velocity limit, and what the controller has seen of it fits."""
    limit, velocity = run.controller.config.limits.velocity, run.parts.robot.arm.derivatives[0]
    most = np.where(limit > 0.0, limit, _USUAL)
    share = 1.0 / max(1.0, float((np.abs(velocity) / most).max()))
    state = run.controller.state
    for speeds in (velocity, state.signals[Signal.VELOCITY], state.hold[Hold.BEFORE], state.hold[Hold.VELOCITY]):
        speeds[:] = share * speeds
    state.history[:] = state.measured + share * (state.history - state.measured)
    _again(run)


def _truth(run: Run) -> None:
    """The arm can be seen: the stop begins with its true motion, and the encoders tell the truth from there on."""
    _outage(run)
    _lie(run)
    _begin(run)


def _impulse(run: Run) -> None:
    """The torque before the stop is that of the true motion without any acceleration, within the limits."""
    arm, effort = run.parts.robot.arm, np.zeros((1, run.limit.size))
    inverse_dynamics(run.true(run.stopped), arm.position, arm.derivatives[0], np.zeros_like(effort), effort)
    run.replace_last_command(np.clip(effort[0], -run.limit, run.limit))
    _again(run)


def _period(run: Run) -> None:
    run.change_rate(_FAST)
    run.controller.state.times[Time.PERIOD] = run.parts.period
    _again(run)


def _torque(run: Run) -> None:
    run.limit = 2.0 * run.limit
    run.controller.config.limits.effort[:] *= 2.0
    run.parts.hardware.plant.effort_limit[:] *= 2.0


def _stiffness(run: Run) -> None:
    run.controller.state.hold_bandwidth[0] *= 2.0


CONDITIONS: dict[str, tuple[Change, str]] = {
    "outage": (_outage, "joint states are lost after the stop"),
    "lie": (_lie, "an encoder lies after the stop"),
    "push": (_push, "something still pushes after the stop"),
    "begin": (_begin, "the motion at the stop is not known"),
    "truth": (_truth, "the arm cannot be seen, neither at the stop nor after it"),
    "load": (_load, "the load is not known"),
    "model": (_model, "the model is not exact"),
    "sensors": (_sensors, "resolution, noise, delay and losses of the measurements"),
    "drives": (_drives, "lag, delay and losses of the drives"),
    "friction": (_friction, "friction"),
    "rate limit": (_rate_limit, "the limit of the torque's rate"),
    "speed": (_speed, "at the stop, the arm is faster than its velocity limit"),
    "impulse": (_impulse, "at the stop, the torque accelerates the arm, and may change by steps only"),
    "period": (_period, "joint states come rarely: the same stop is good at 1 kHz"),
}
"""What a controller cannot change: how to take it away at the stop, in this order, and what it is."""
CHOICES: dict[str, tuple[Change, str]] = {
    "torque": (_torque, "motors: with twice the torque the stop is good"),
    "soft": (_stiffness, "the hold is soft: with twice its bandwidth the stop is good"),
}
"""What an arm or its parameters choose, likewise."""
LIMITS, CONTROLLER = "limits", "controller"
OTHERS = {
    LIMITS: "the best braking is bad, too",
    CONTROLLER: "none of these: the controller is to blame",
}
_EVERY = {name: change for name, (change, _) in (CONDITIONS | CHOICES).items()}
_MOST, _LONGEST = 3, 6
"""Conditions that together are an explanation: of all combinations, and one after the other."""


def _present(run: Run) -> list[str]:
    """Names of what the case has, and of what may be; the rest would change nothing."""
    kinds, hardware = {Kind(int(row[0])) for row in run.events.table}, run.parts.hardware
    velocity, limit = run.trace.velocity[run.stopped], run.controller.config.limits.velocity
    lies = bool(kinds & {Kind.OFF, Kind.MIRRORED, Kind.NEGATED, Kind.FROZEN})
    absent = {
        "outage": Kind.LOSS not in kinds,
        "lie": not lies,
        "push": Kind.PUSH not in kinds,
        "truth": not lies and Kind.LOSS not in kinds,
        "sensors": hardware.sensor.ideal and hardware.measurements.direct,
        "drives": hardware.actuator.ideal and hardware.commands.direct,
        "friction": hardware.plant.friction.none,
        "rate limit": not run.controller.config.limits.effort_rate.any(),
        "speed": bool((np.abs(velocity) <= np.where(limit > 0.0, limit, _USUAL)).all()),
        "period": run.case.simulator["rate"] >= _FAST,
    }
    return [name for name in _EVERY if not absent.get(name, False)]


def _without(run: Run, names: Iterable[str]) -> Outcome:
    """The stop without some conditions."""
    changes = [_EVERY[name] for name in _EVERY if name in names]

    def change(other: Run) -> None:
        for each in changes:
            each(other)

    return judge(run.with_other(change))


def explain(run: Run) -> str:
    """The explanation of a bad stop: names of `CONDITIONS` and `CHOICES` joined by a plus, or one of `OTHERS`."""
    if judge(run.with_other(_drives, stop_ideally)).why:
        return LIMITS
    present = _present(run)
    single = {}
    for name in present:
        single[name] = _without(run, [name])
        if not single[name].why:
            return name
    found = _one_by_one(run, present, min(present, key=lambda name: single[name].worst_ratio))
    return "+".join(found or _together(run, present)) or CONTROLLER


def _one_by_one(run: Run, present: list[str], first: str) -> list[str]:
    """Conditions that are all needed, beginning with the most important one; none if the stop remains bad."""
    gone, good = [first], False
    while not good and len(gone) < min(_LONGEST, len(present)):
        left = {name: _without(run, [*gone, name]) for name in present if name not in gone}
        gone.append(min(left, key=lambda name: left[name].worst_ratio))
        good = not left[gone[-1]].why
    if not good:
        most = [present, *([other for other in present if other != name] for name in present)]
        gone = next((names for names in most if not _without(run, names).why), [])
    for name in list(gone):
        fewer = [other for other in gone if other != name]
        if not _without(run, fewer).why:
            gone = fewer
    return [name for name in present if name in gone]


def _together(run: Run, present: list[str]) -> tuple[str, ...]:
    """The first pair or triple without which the stop is good; none: empty."""
    for size in range(2, _MOST + 1):
        for some in combinations(present, size):
            if not _without(run, some).why:
                return some
    return ()
