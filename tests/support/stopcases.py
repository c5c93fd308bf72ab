"""Random cases of a stop: an arm, a controller, hardware, a motion, and what makes the controller stop.

A case is a pure function of seed and index (`case_of`), and plain data: `Case.from_text` reads what `Case.text` wrote,
so that a case remains the same when the generator changes.
"""

import json
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import PRACTICAL, practical_settings, tuned_parameters
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters.files import load_ros_parameters
from support.stopcauses import CAUSES, FOREVER, SHIPPED, Draft, Event, Random, effort_share, lighten, model_of, rated
from support.stoploop import Kind
from support.testarms import CRANE, PENDULUM, Arm

ARMS = {"pendulum": PENDULUM, "crane": CRANE} | {name: Arm(name, ()) for name in SHIPPED}
_SHARES = {"pendulum": 0.14, "crane": 0.14, "two_link": 0.16}
RATES = (100, 200, 250, 500, 1000, 2000)
_CAUSE = (0.9, 1.5)
"""s; when the cause of the stop happens."""
_ROTORS, _FRICTION = 0.005, 0.1
"""Inertia of rotors, kg m^2 per N m of the effort limit, as on geared arms; Coulomb friction, as a share of it."""
_AFTER = 2.5
"""s of a case after the stop."""
_WAIT = 0.8
"""s for a stop after its cause."""


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes:
        seed, index: where it comes from, see `case_of`.
        arm: a name in `ARMS`.
        cause: what makes the controller stop, a name in `CAUSES`.
        blind: an encoder lies, or no joint state arrives any more: without brakes, the arm cannot be seen.
        kind: law, set of parameters, and hardware, for tables.
        controller, simulator, trajectory: parameters that differ from the defaults; the arm is not among them.
        events: what happens, see `Event`.
        until: duration without a stop, s.
        after: duration after a stop, s.
    """

    seed: int
    index: int
    arm: str
    cause: str
    blind: bool
    kind: dict[str, Any]
    controller: dict[str, Any]
    simulator: dict[str, Any]
    trajectory: dict[str, Any]
    events: list[Event]
    until: float
    after: float = _AFTER

    @property
    def text(self) -> str:
        """The case on one line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_text(cls, text: str) -> "Case":
        content = json.loads(text)
        content["events"] = [tuple(event) for event in content["events"]]
        return cls(**content)


_WEIGHTS = {"glitch": 4.0, "collision": 3.0, "tracking error": 2.0, "jump": 2.0, "measurement": 2.0}


@cache
def _names() -> tuple[list[str], Array, list[str], Array]:
    arms, causes = list(ARMS), list(CAUSES)
    rest = 1.0 - sum(_SHARES.values())
    arm = np.array([_SHARES.get(name, rest / (len(arms) - len(_SHARES))) for name in arms])
    cause = np.array([_WEIGHTS.get(name, 1.0) for name in causes])
    return arms, arm / arm.sum(), causes, cause / cause.sum()


def case_of(seed: int, index: int) -> Case:
    """The case of a seed and an index."""
    random = np.random.default_rng([seed, index])
    arms, shares, causes, weights = _names()
    name, cause = str(random.choice(arms, p=shares)), str(random.choice(causes, p=weights))
    draft = _draft(random, ARMS[name])
    kind = _controlled(draft) | {"hardware": _hardware(draft), "rate": draft.rate}
    _load(draft)
    _rate_limits(draft)
    if random.random() < 0.2:
        draft.controller["stop.bandwidth"] = round(float(random.uniform(4.0, 16.0)), 1)
    CAUSES[cause](draft)
    for _ in range(int(random.random() < 0.35)):
        draft.joint = int(random.integers(draft.arm.joints))
        draft.pushes((0.1, 5.0), after=float(random.uniform(0.6, 1.5)))
    extra = _second_glitch(draft) if random.random() < 0.1 else {}
    return _case(draft, (seed, index), name, cause, kind | extra)


def case_with_unknown_rotors_of(seed: int, index: int) -> Case:
    """The case of `case_of` on an arm with other rotors than those of its description, and friction.

    Closed forms have no rotors: they keep their case.
    """
    case = case_of(seed, index)
    if case.arm not in SHIPPED or case.arm == "two_link":
        return case
    limits = ARMS[case.arm].limits
    unknown = {
        "robot.armature": (_ROTORS * limits).tolist(),
        "friction.coulomb": (_FRICTION * limits).tolist(),
        "friction.stribeck_velocity": 0.05,
    }
    return replace(case, simulator=case.simulator | unknown)


def ordinary_case_of(seed: int, index: int) -> Case:
    """A case in which nothing should stop the arm."""
    random = np.random.default_rng([seed, index, 1])
    arms, shares, _, _ = _names()
    name = str(random.choice(arms, p=shares))
    draft = _draft(random, ARMS[name], gentle=True)
    draft.rate = int(random.choice((500, 1000, 2000)))
    # Gains for real sensors wherever there are any.
    hardware = _hardware(draft)
    kind = _controlled(draft, fits=hardware) | {"hardware": hardware, "rate": draft.rate}
    _load(draft)
    happens = str(random.choice(["nothing", "leaning", "locked", "touch"]))
    if happens == "leaning":
        draft.leans(0.1)
    elif happens == "touch":
        draft.pushes((0.05, 0.5))
    elif happens == "locked":
        draft.trajectory["reference.amplitude"] = 0.0
        draft.simulator |= {"initial_position": draft.trajectory["reference.offset"], "command.timeout": 0.02}
        draft.happens(Kind.LOCKED, 0.0, 1.5)
    return _case(draft, (seed, index), name, happens, kind, until=4.0)


def _case(
    draft: Draft, place: tuple[int, int], arm: str, cause: str, kind: dict[str, Any], until: float | None = None
) -> Case:
    if any(event[0] == Kind.PUSH.name for event in draft.events):
        draft.simulator |= {"push.time": 0.0, "push.duration": FOREVER}
    made = Case(
        *place,
        arm=arm,
        cause=cause,
        blind=draft.blind,
        kind=kind,
        controller=draft.controller,
        simulator=draft.simulator | {"rate": draft.rate, "disturbance.name": "none", "seed": place[1]},
        trajectory=draft.trajectory,
        events=draft.events,
        until=until or round(draft.at + _WAIT, 3),
    )
    return Case.from_text(made.text)


def _draft(random: Random, arm: Arm, gentle: bool = False) -> Draft:
    """An arm with a motion from rest, in which no torque exceeds 60 % of its limit; at times, it stays where it is."""
    robot, n = arm.robot, arm.joints
    fastest = np.array(robot.velocity_limit) if robot.velocity_limit else np.full(n, 2.5)
    fastest = np.minimum(np.where(np.isfinite(fastest), fastest, 2.5), 3.0)
    frequency = random.uniform(0.2, 0.9, n)
    share = random.uniform(0.05, 0.4 if gentle else 0.6) * (random.random() > 0.12)
    amplitude = share * random.uniform(0.3, 1.0, n) * fastest / (2.0 * np.pi * frequency)
    middle, half = np.array(robot.initial_position), np.full(n, np.inf)
    if robot.position_limits:
        half = 0.5 * np.diff(np.array(robot.position_limits), axis=1)[:, 0]
    half = np.where(np.isfinite(half), half, 2.0)
    middle = middle + random.uniform(-0.4, 0.4, n) * half
    amplitude = np.minimum(amplitude, 0.5 * half)
    for _ in range(12):
        if effort_share(arm, model_of(arm), middle, amplitude, 2.0 * np.pi * frequency) < 0.6:
            break
        amplitude = 0.7 * amplitude
        middle = np.array(robot.initial_position) + 0.8 * (middle - robot.initial_position)
    trajectory = {
        "reference.name": "sines",
        "reference.amplitude": amplitude.tolist(),
        "reference.frequency": frequency.tolist(),
        "reference.phase": -0.5 * np.pi,
        "reference.offset": middle.tolist(),
    }
    return Draft(
        random=random,
        arm=arm,
        rate=int(random.choice(RATES, p=(0.1, 0.1, 0.1, 0.2, 0.4, 0.1))),
        at=round(float(random.uniform(*_CAUSE)), 3),
        joint=int(random.integers(n)),
        speed=amplitude * 2.0 * np.pi * frequency,
        simulator={"initial_position": (middle - amplitude).tolist(), "command.timeout": 0.0},
        trajectory=trajectory,
    )


def _controlled(draft: Draft, fits: str = "") -> dict[str, Any]:
    """Choose law and parameters; return their names.

    Args:
        draft: the case.
        fits: hardware that the parameters must fit; empty: any parameters will do.
    """
    random, arm = draft.random, draft.arm
    sets = [PRACTICAL] + (["tuned"] if arm.description in SHIPPED else [])
    # The defaults fit the two-link arm with ideal sensors.
    if not fits or (fits == "ideal" and arm.description == "two_link"):
        sets.append("default")
    chosen = str(random.choice(sets))
    law = "piddtsm"
    if chosen == "default":
        laws = [each for each in LAWS.names if each != "pidnftsm" or arm.joints <= 2]
        law = str(random.choice(laws))
        draft.controller |= {"law.name": law, **arm_gains(arm, law)}
        if random.random() < 0.4 and not fits:
            estimators = ["filtered_difference", "extended_state_observer", "robust_differentiator"]
            draft.controller["estimator.name"] = str(random.choice(estimators))
    elif chosen == PRACTICAL:
        settings = {"simulator": {"rate": draft.rate}, "controller": dict(arm.settings)}
        draft.controller |= practical_settings(None, settings)["controller"]
    else:
        bits = str(random.choice(["12bit", "14bit", "17bit"]))
        if fits:
            bits = next((each for each in ("17bit", "14bit") if each.replace("b", " b") in fits), "12bit")
        chosen = f"tuned_{bits}"
        file = tuned_parameters(chosen, None, {"simulator": {}, "controller": dict(arm.settings)})
        draft.controller |= load_ros_parameters(file)["controller"]
    draft.controller["activation.blend"] = 0.0
    return {"law": law, "set": chosen}


def arm_gains(arm: Arm, law: str) -> dict[str, Any]:
    """See `Arm.gains`; arms without a start posture have that of their description."""
    start = arm.start or arm.robot.initial_position
    return Arm(arm.description, tuple(start)).gains(law)


def _hardware(draft: Draft) -> str:
    """Choose sensors and drives; return their names."""
    random, simulator, found = draft.random, draft.simulator, []
    bits = int(random.choice([0, 14, 12, 17], p=(0.35, 0.35, 0.2, 0.1)))
    if bits:
        simulator["encoder.bits"] = bits
        found.append(f"{bits} bit")
        simulator["delay.samples"] = max(1, round(1e-3 * draft.rate)) if random.random() < 0.6 else 0
        if simulator["delay.samples"]:
            found.append("delay")
    if random.random() < 0.2:
        simulator["noise.std"] = float(10.0 ** random.uniform(-5.0, -3.7))
        found.append("noise")
    if random.random() < 0.3:
        share = random.uniform(0.005, 0.05)
        simulator |= {"friction.coulomb": (share * draft.arm.limits).tolist(), "friction.stribeck_velocity": 0.05}
        found.append("friction")
    if random.random() < 0.25:
        simulator["actuator.lag"] = float(random.uniform(0.001, 0.006))
        found.append("lag")
    if random.random() < 0.15:
        simulator["delay.command_samples"] = 1
        found.append("command delay")
    if random.random() < 0.1:
        simulator |= {"dropout.probability": 0.02, "dropout.command_probability": 0.02}
        found.append("losses")
    return ", ".join(found) or "ideal"


def _load(draft: Draft) -> None:
    """Choose the errors of the model, and a payload that the controller knows or does not know."""
    random = draft.random
    if random.random() < 0.5:
        for quantity in ("mass", "inertia"):
            draft.simulator[f"model_error.{quantity}"] = round(float(random.uniform(-0.23, 0.43)), 3)
    chosen = str(random.choice(["none", "known", "unknown"], p=(0.5, 0.2, 0.3)))
    if chosen != "none":
        mass = round(float(random.uniform(0.2, 1.0)) * rated(draft.arm), 3)
        draft.simulator["payload.mass"] = mass
        lighten(draft)
        if chosen == "known":
            draft.controller["payload.mass"] = draft.simulator["payload.mass"]


def _rate_limits(draft: Draft) -> None:
    """Choose the limits of the torques' rates: none, or 1 to 20 times the limit of the torque per second."""
    if draft.random.random() < 0.4:
        times = np.exp(draft.random.uniform(0.0, np.log(20.0), draft.arm.joints))
        if draft.random.random() < 0.5:
            times[:] = times[0]
        draft.controller["limits.effort_rate"] = (times * draft.arm.limits).round(2).tolist()


def _second_glitch(draft: Draft) -> dict[str, Any]:
    """The encoder of a stopped arm is wrong once more."""
    draft.happens(Kind.OFF, draft.either(1e-3, 1.0), draft.samples(1, 10), after=float(draft.random.uniform(0.3, 1.2)))
    return {"second glitch": True}
