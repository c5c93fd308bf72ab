"""A stop, judged by what the arm really does: is it worse than what it stops?

After the stop the time is divided at pushes into *stretches* in which no outside force acts. Each stretch is judged
from the true motion at its begin: the stop, or the end of a push, which no controller can undo. w is the bandwidth of
the hold (``stop.bandwidth``), whose three poles are at -w.

travel: no joint gets farther from where it was than 0.05 rad plus twice the way of the best braking. After a push, it
    may return to where it was before.
speed: no joint gets faster than it was, or than in the best braking, plus an allowance: the speed with which the hold
    returns from a distance d, 0.8 w d. Here d is the 0.05 rad that travel allows, plus how far the push has moved the
    joint. So an arm at rest may move as fast as one that returns from a distance that is allowed.
energy: between no two times more than 50 ms apart does the energy grow by more than 5 % of the largest so far plus the
    kinetic energy of joints with the allowed speeds. The energy is the kinetic one of the true arm plus that of the
    hold's spring, 0.5 d' 3 w^2 H d, where d is the distance from where the arm comes to rest, and H the true inertia
    there. Gravity is in it: at rest the hold carries the arm, so that near this place the potential of gravity and that
    of the constant torque cancel. The 5 % are what the integral adds when the hold overshoots: 2 % with its poles.

A push that ends is a disturbance, as one that begins: the hold still opposes it. What remains of its torque accelerates
the arm by a, of which the hold with its bandwidth makes a distance of 0.27 a / w^2 and a speed of 0.23 a / w. Both are
allowed in addition. The remainder is the torque of the motors beyond gravity, as far as it opposes the push.

Over the whole time after the stop:

step: no torque changes by more than 10 % of its limit from one command to the next.
torque: no torque is beyond its limit.
finite: every torque is finite, and so is the motion.

*The best braking* knows the true arm with its payload, and its true motion. It decelerates all joints in proportion to
their velocities, at every instant as strongly as the inverse dynamics allow within the limits of the torques; but it
begins with the torque that was applied, changes it by at most 10 % of its limit per command, as `step` demands, and
only after the delays of sensors and drives. Friction does not help it.

A joint that slides has m instead of rad.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots import Model, inverse_dynamics
from support.stopcases import case_of
from support.stoploop import STEP, brake, kinetic
from support.stoprun import Run

CRITERIA = ("travel", "speed", "energy", "step", "torque", "finite")
ALLOWED_WAY, TIMES_WAY = 0.05, 2.0
"""rad; and how many times the way of the best braking."""
_RETURN = 0.8
"""Largest speed of the return from a distance, relative to the bandwidth times this distance."""
_RELEASED = (0.271, 0.231)
"""Distance and speed after a step of a torque, with poles at -1: maxima of t^2 exp(-t) / 2 and of its derivative."""
_GROWS, _SHARE = 0.05, 0.05
"""s, and share of the energy."""
_ROUNDING = 1e-9
_RESTED = 0.3
"""s at the end over which the place of rest is averaged."""


@dataclass(frozen=True)
class Outcome:
    """What a case came to.

    Attributes:
        fault: name of the fault; empty: the controller did not stop.
        time: of the stop, s.
        worst: by name in `CRITERIA`, the largest value relative to what is allowed; more than 1 is a violation.
        moved: largest distance of a joint from where it was, rad or m.
        why: for each violation, what exceeded what; empty: none.
        explanation: without what it would be good, see `stopwhy`; empty: not asked.
    """

    index: int
    arm: str
    cause: str
    blind: bool
    kind: dict[str, Any]
    fault: str
    time: float
    worst: dict[str, float]
    moved: float
    why: list[str]
    explanation: str = ""

    @property
    def stopped(self) -> bool:
        return bool(self.fault)

    @property
    def worst_ratio(self) -> float:
        """The largest of `worst`."""
        return max(self.worst.values(), default=0.0)

    @property
    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


def best_braking(run: Run, first: int) -> tuple[Array, Array]:
    """Way and largest speed of each joint in the best braking from sample `first` on, rad and rad/s."""
    trace, n = run.trace, run.limit.size
    applied = trace.applied[max(first - 1, 0)]
    state = np.array([trace.position[first], trace.velocity[first], applied])
    way, fastest = np.zeros(n), np.zeros(n)
    brake(run.true(first), run.braking, state, way, fastest, np.zeros((7, n)))
    return way, fastest


def inertia(model: Model, q: Array) -> Array:
    """Inertia matrix, shape (joints, joints), kg m^2."""
    n = q.size
    accelerations, efforts = np.vstack([np.zeros(n), np.eye(n)]), np.zeros((n + 1, n))
    inverse_dynamics(model, np.ascontiguousarray(q), np.zeros(n), accelerations, efforts)
    return efforts[1:] - efforts[0]


def released(run: Run, first: int) -> Array:
    """Acceleration of each joint by what has just changed outside, rad/s^2, positive.

    This is what still opposes a push that has ended, or the weight of a load that has been picked up.
    """
    trace, q = run.trace, run.trace.position[first]
    push, true = trace.push[max(first - 1, 0)], run.true(first)
    torque = np.sign(push) * np.clip(-np.sign(push) * (trace.applied[first - 1] - gravity(true, q)), 0.0, np.abs(push))
    if first == run.picked > run.stopped:
        torque = torque + gravity(true, q) - gravity(run.true(first - 1), q)
    return np.asarray(np.abs(np.linalg.solve(inertia(true, q), torque))) if torque.any() else torque


def gravity(model: Model, q: Array) -> Array:
    """Torque that carries the arm at rest, shape (joints,), N m."""
    torque = np.zeros((1, q.size))
    inverse_dynamics(model, np.ascontiguousarray(q), np.zeros(q.size), np.zeros((1, q.size)), torque)
    return torque[0]


def energy(run: Run, stretch: slice) -> Array:
    """Kinetic plus spring energy at each sample, J."""
    trace = run.trace
    q, dq = (np.ascontiguousarray(table[stretch]) for table in (trace.position, trace.velocity))
    rest = np.median(q[-max(1, round(_RESTED / run.dt)) :], axis=0)
    true = run.true(stretch.start)
    stiffness = 3.0 * run.bandwidth**2 * inertia(true, rest)
    result = np.zeros(len(q))
    kinetic(true, q, dq, np.zeros((4, q.shape[1])), result)
    away = q - rest
    spring = 0.5 * np.einsum("ki,ij,kj->k", away, stiffness, away)
    return np.asarray(result + spring)


def _growth(energies: Array, apart: int, floor: float) -> float:
    """Largest growth between two times more than `apart` samples apart, relative to what is allowed."""
    if energies.size <= apart + 1:
        return 0.0
    least = np.minimum.accumulate(energies)[: -apart - 1]
    largest = np.maximum.accumulate(energies)[: -apart - 1]
    return float(((energies[apart + 1 :] - least) / (_SHARE * largest + floor)).max())


def judge(run: Run) -> Outcome:
    """Judge a run by all criteria; without a stop, there is nothing to judge."""
    case, moved = run.case, 0.0
    worst: dict[str, float] = dict.fromkeys(CRITERIA, 0.0)
    why: list[str] = []
    if run.stopped < 0:
        worst = {}
    else:
        moved = _judge_motion(run, worst, why)
        _judge_torque(run, worst, why)
    return Outcome(
        index=case.index,
        arm=case.arm,
        cause=case.cause,
        blind=case.blind,
        kind=case.kind,
        fault=run.fault,
        time=round(run.stopped * run.dt, 4),
        worst={name: round(min(value, 1e6), 4) for name, value in worst.items()},
        moved=round(moved, 5),
        why=why if run.stopped >= 0 else [] if run.finite else ["not finite, and not stopped"],
    )


@dataclass
class Allowed:
    """What is allowed in a stretch, one value per joint, rad and rad/s.

    Attributes:
        low, high: between these positions, a joint is where it was.
        travel: distance beyond them.
        speed: that of the best braking, at least that at the begin.
        faster: speed beyond that.
    """

    low: Array
    high: Array
    travel: Array
    speed: Array
    faster: Array

    @classmethod
    def of(cls, run: Run, stretch: slice, held: Array) -> "Allowed":
        """Args: held: where the arm was before, rad."""
        here = run.trace.position[stretch.start]
        low, high = np.minimum(here, held), np.maximum(here, held)
        way, fastest = best_braking(run, stretch.start)
        after_push = released(run, stretch.start)
        faster = _RETURN * run.bandwidth * (ALLOWED_WAY + high - low) + _RELEASED[1] * after_push / run.bandwidth
        travel = ALLOWED_WAY + TIMES_WAY * way + _RELEASED[0] * after_push / run.bandwidth**2
        return cls(low, high, travel, fastest, faster)


def _judge_motion(run: Run, worst: dict[str, float], why: list[str]) -> float:
    """Judge all stretches; return the largest distance."""
    farthest, held = 0.0, run.trace.position[run.stopped]
    for stretch in run.stretches():
        allowed, positions = Allowed.of(run, stretch, held), run.trace.position[stretch]
        moved = np.maximum(positions - allowed.high, allowed.low - positions).max(axis=0)
        faster = np.abs(run.trace.velocity[stretch]).max(axis=0) - allowed.speed
        farthest, held = max(farthest, float(moved.max())), positions[-1]
        since = f"{run.dt * (stretch.start - run.stopped):.2f} s after the stop"
        for name, values, most in (("travel", moved, allowed.travel), ("speed", faster, allowed.faster)):
            j = int((values / most).argmax())
            ratio = float(values[j] / most[j])
            if ratio > max(1.0, worst[name]):
                beyond = "" if name == "travel" else " more"
                why.append(f"{name}: joint {j + 1} {values[j]:.3g}{beyond}, allowed {most[j]:.3g}, from {since}")
            worst[name] = max(worst[name], ratio)
        if len(positions) * run.dt < 2.0 * _RESTED:
            continue  # The arm has not come to rest before the next push.
        floor = 0.5 * float(np.diag(inertia(run.true(stretch.start), positions[-1])) @ allowed.faster**2)
        growth = _growth(energy(run, stretch), round(_GROWS / run.dt), floor)
        if growth > max(1.0, worst["energy"]):
            why.append(f"energy: grows by {growth:.3g} times what is allowed, from {since}")
        worst["energy"] = max(worst["energy"], growth)
    return farthest


def _judge_torque(run: Run, worst: dict[str, float], why: list[str]) -> None:
    trace = run.trace
    begun = int(np.argmax(trace.command.any(axis=1)))  # Before, there was no command.
    commands = trace.command[max(run.stopped - 1, begun) :]
    steps = np.abs(np.diff(commands, axis=0)) / run.limit
    if steps.size:
        k, j = np.unravel_index(int(steps.argmax()), steps.shape)
        worst["step"] = float(steps[k, j]) / STEP
        if worst["step"] > 1.0 + _ROUNDING:
            when = f"{k * run.dt:.3f} s after the stop"
            why.append(f"step: joint {j + 1} {steps[k, j]:.3g} of its limit, {when}")
    worst["torque"] = float((np.abs(commands) / run.limit).max())
    if worst["torque"] > 1.0 + _ROUNDING:
        why.append(f"torque: {worst['torque']:.6g} of its limit")
    if not run.finite:
        worst["finite"] = 1e6
        why.append("finite: torque or motion is not finite, or faster than 10,000 rad/s")
    for name in ("step", "torque"):
        worst[name] = min(worst[name], 1.0) if worst[name] <= 1.0 + _ROUNDING else worst[name]


def run_case(seed: int, index: int) -> Outcome:
    """Simulate and judge the case of a seed and an index."""
    return judge(Run(case_of(seed, index)))
