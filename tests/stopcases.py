"""Random cases of a stop: an arm, a controller, hardware, a motion, and what makes the controller stop.

A case is a pure function of seed and index (`case_of`), and plain data: `Case.from_text` reads what `Case.text` wrote,
so that a case remains the same when the generator changes.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import cache
from typing import Any

import numpy as np
from stoploop import Kind
from testarms import CRANE, PENDULUM, Arm

from pidtsm_core.control import controller_schema
from pidtsm_core.experiment import PRACTICAL, practical_settings, tuned_parameters
from pidtsm_core.laws import LAWS
from pidtsm_core.parameter_files import load_ros_parameters
from pidtsm_core.parameters import Array, as_float, resolve
from pidtsm_core.robots import Model, inverse_dynamics, make_model
from pidtsm_core.robots.payload import payload_of
from pidtsm_core.robots.source import rated_payload
from pidtsm_core.simulation.simulator import simulator_schema

Random = np.random.Generator
Event = tuple[str, int, float, float, float]
"""Name of the `Kind`, joint, begin (s), duration (s; 0: one sample), size."""

SHIPPED = ("two_link", "scara", "ur5", "panda", "xarm7", "z1")
ARMS = {"pendulum": PENDULUM, "crane": CRANE} | {name: Arm(name, ()) for name in SHIPPED}
_SHARES = {"pendulum": 0.14, "crane": 0.14, "two_link": 0.16}
RATES = (100, 200, 250, 500, 1000, 2000)
_CAUSE = (0.9, 1.5)
"""s; when the cause of the stop happens."""
_AFTER = 2.5
"""s of a case after the stop."""
_WAIT = 0.8
"""s for a stop after its cause."""
_PUSHED = 0.2
"""Longest push, where nothing else is said, s."""
_POSSIBLE = 0.85
"""Largest share of a torque limit that the true arm with its payload needs."""
FOREVER = 100.0
"""s."""


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


@dataclass
class Draft:
    """A case that is being made; causes change it."""

    random: Random
    arm: Arm
    rate: int
    at: float
    joint: int
    speed: Array
    controller: dict[str, Any] = field(default_factory=dict)
    simulator: dict[str, Any] = field(default_factory=dict)
    trajectory: dict[str, Any] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    blind: bool = False

    def happens(self, kind: Kind, size: float = 0.0, lasts: float = 0.0, joint: int = -1, after: float = 0.0) -> None:
        """Add an event."""
        place = self.joint if joint < 0 else joint
        self.events.append((kind.name, place, round(self.at + after, 4), lasts, float(size)))

    def either(self, low: float, high: float) -> float:
        """A number with a random sign whose logarithm is uniform."""
        return float(np.exp(self.random.uniform(np.log(low), np.log(high))) * self.random.choice([-1.0, 1.0]))

    def limit(self, name: str, value: float, others: float = 0.0) -> None:
        """Limit one joint; the others have another limit."""
        values = np.full(self.arm.joints, others)
        values[self.joint] = value
        self.controller[f"limits.{name}"] = values.tolist()

    def jumps(self, size: float) -> None:
        """The reference of the joint jumps."""
        jump = np.zeros(self.arm.joints)
        jump[self.joint] = size * self._length(self.joint)
        self.trajectory |= {"jump.time": self.at, "jump.position": jump.tolist()}

    def pushes(self, speed: tuple[float, float], after: float = 0.0, longest: float = _PUSHED) -> None:
        """Something pushes the joint, as strongly as would give it a speed, but at most with its largest torque."""
        lasts, q = float(self.random.uniform(0.02, longest)), np.array(self.trajectory["reference.offset"])
        inertia = self.arm.robot.joint_inertia(_model(self.arm).parameters, q)[self.joint]
        size = self.either(*speed) * self._length(self.joint) * inertia / lasts
        most = self.arm.limits[self.joint]
        self.happens(Kind.PUSH, float(np.clip(size, -most, most)), lasts, after=after)

    def leans(self, share: float) -> None:
        """Something leans on the joint, ever more strongly for half a second, up to a share of its largest torque."""
        size = self.either(0.1 * share, share) * self.arm.limits[self.joint] / 10.0
        for i in range(10):
            self.happens(Kind.PUSH, size, FOREVER, after=0.05 * i)

    def samples(self, low: int, high: int) -> float:
        """Duration of some samples, s."""
        return float(self.random.integers(low, high + 1)) / self.rate

    def _length(self, joint: int) -> float:
        """0.25 m for a radian of a joint that slides."""
        return 0.25 if self.arm.robot.slides and self.arm.robot.slides[joint] else 1.0


def _glitch(draft: Draft) -> None:
    """The encoder is wrong for 1 to 10 samples; the velocity limit is that of the arm, or just above the motion."""
    draft.happens(Kind.OFF, draft.either(1e-3, 1.0), draft.samples(1, 10))
    _tighten(draft, 0.6)


def _tighten(draft: Draft, share: float) -> None:
    """Often limit the velocity to little more than that of the motion, so that little makes the arm stop."""
    if draft.random.random() < share:
        most = draft.random.uniform(1.2, 2.0) * np.maximum(draft.speed, 0.1)
        draft.controller["limits.velocity"] = most.tolist()
    elif not draft.arm.robot.velocity_limit:
        draft.controller["limits.velocity"] = 2.5


def _alternate(draft: Draft) -> None:
    """The encoder is wrong in turn in either direction."""
    size = draft.either(1e-3, 1.0)
    for i in range(int(draft.random.integers(2, 5))):
        draft.happens(Kind.OFF, size * (-1.0) ** i, after=2.0 * i / draft.rate)
    _tighten(draft, 0.7)


def _gap(draft: Draft) -> None:
    """One gap; while a long one lasts, the arm cannot be seen."""
    lasts = float(draft.random.uniform(0.02, 0.3))
    draft.blind = lasts > 0.1
    draft.happens(Kind.LOSS, 0.0, lasts + 5.5 / draft.rate)


def _gaps(draft: Draft) -> None:
    for after in np.sort(draft.random.uniform(0.0, 1.0, 5)):
        draft.happens(Kind.LOSS, 0.0, float(draft.random.uniform(0.01, 0.1)) + 5.5 / draft.rate, after=float(after))


def _silence(draft: Draft) -> None:
    draft.blind = True
    draft.happens(Kind.LOSS, 0.0, FOREVER)


def _position(draft: Draft) -> None:
    """A limit of position lies in the way; a joint at rest is pushed."""
    start, middle = draft.simulator["initial_position"][draft.joint], draft.trajectory["reference.offset"][draft.joint]
    way = middle - start
    if abs(way) < 1e-4:
        draft.pushes((0.2, 5.0))
        way = 0.01
    edge = start + way * draft.random.uniform(0.3, 1.8)
    least, most = np.full(draft.arm.joints, -50.0), np.full(draft.arm.joints, 50.0)
    if way > 0.0:
        most[draft.joint] = edge
    else:
        least[draft.joint] = edge
    draft.controller |= {"limits.min_position": least.tolist(), "limits.max_position": most.tolist()}


def _velocity(draft: Draft) -> None:
    draft.limit("velocity", float(draft.random.uniform(0.5, 0.95)) * max(draft.speed[draft.joint], 0.02))


def _tracking(draft: Draft) -> None:
    draft.controller["limits.tracking_error"] = float(draft.random.uniform(0.005, 0.3))
    draft.jumps(draft.either(0.02, 1.0))


def _jump(draft: Draft) -> None:
    """A jump makes the arm so fast that it stops."""
    draft.jumps(draft.either(0.05, 1.5))
    _tighten(draft, 0.5)


def _collision(draft: Draft) -> None:
    """A push causes the stop: by velocity, error, or by itself."""
    draft.pushes((0.2, 5.0))
    _tighten(draft, 0.5)
    draft.controller["limits.tracking_error"] = float(draft.random.uniform(0.02, 0.3))
    if draft.random.random() < 0.3 and LAWS[draft.controller["law.name"]].uses_model:
        draft.controller["limits.external_effort_action"] = "stop"


def _external(draft: Draft) -> None:
    if LAWS[draft.controller["law.name"]].uses_model:
        draft.controller["limits.external_effort_action"] = "stop"
        draft.controller["limits.external_effort"] = (draft.random.uniform(0.05, 0.25) * draft.arm.limits).tolist()
    else:
        draft.controller["limits.tracking_error"] = 0.05
    draft.pushes((0.3, 5.0), longest=0.5)


def _rate(draft: Draft) -> None:
    """The rate limit is too tight for the motion."""
    share = float(draft.random.uniform(0.02, 1.0))
    draft.controller["limits.effort_rate"] = (share * draft.arm.limits).tolist()
    draft.jumps(draft.either(0.05, 1.0))


def _measurement(draft: Draft) -> None:
    """Too many implausible measurements in a row."""
    draft.happens(Kind.OFF, draft.either(0.05, 3.0), draft.samples(6, 30))


def _flip(draft: Draft) -> None:
    draft.blind = True
    draft.happens(Kind.NEGATED if draft.random.random() < 0.5 else Kind.MIRRORED, 0.0, FOREVER)
    _tighten(draft, 0.3)
    draft.controller.setdefault("limits.tracking_error", 0.1)


def _freeze(draft: Draft) -> None:
    draft.blind = True
    draft.happens(Kind.FROZEN, 0.0, FOREVER)
    draft.controller["limits.tracking_error"] = float(draft.random.uniform(0.02, 0.2))


def _freeze_all(draft: Draft) -> None:
    draft.blind = True
    for joint in range(draft.arm.joints):
        draft.happens(Kind.FROZEN, 0.0, FOREVER, joint=joint)
    draft.controller["limits.tracking_error"] = float(draft.random.uniform(0.02, 0.2))


def _step(draft: Draft) -> None:
    draft.blind = True
    draft.happens(Kind.OFF, draft.either(0.01, 1.0), FOREVER)
    _tighten(draft, 0.4)


def _pickup(draft: Draft) -> None:
    """A load is picked up or dropped, so that the arm strays from its reference."""
    mass = round(float(draft.random.uniform(0.5, 1.0)) * _rated(draft.arm), 3)
    draft.simulator |= {"payload.mass": mass, "payload.time": draft.at}
    _lighten(draft)
    draft.controller["limits.tracking_error"] = 0.01
    draft.controller["limits.effort_rate"] = 0.0


CAUSES: dict[str, Callable[[Draft], None]] = {
    "glitch": _glitch,
    "alternating glitches": _alternate,
    "gap": _gap,
    "gaps": _gaps,
    "silence": _silence,
    "position limit": _position,
    "velocity limit": _velocity,
    "tracking error": _tracking,
    "jump": _jump,
    "collision": _collision,
    "external effort": _external,
    "effort rate": _rate,
    "measurement": _measurement,
    "flipped encoder": _flip,
    "frozen encoder": _freeze,
    "all frozen": _freeze_all,
    "step of an encoder": _step,
    "payload": _pickup,
}
"""What makes the controller stop."""
_WEIGHTS = {"glitch": 4.0, "collision": 3.0, "tracking error": 2.0, "jump": 2.0, "measurement": 2.0}


@cache
def _names() -> tuple[list[str], Array, list[str], Array]:
    arms, causes = list(ARMS), list(CAUSES)
    rest = 1.0 - sum(_SHARES.values())
    arm = np.array([_SHARES.get(name, rest / (len(arms) - len(_SHARES))) for name in arms])
    cause = np.array([_WEIGHTS.get(name, 1.0) for name in causes])
    return arms, arm / arm.sum(), causes, cause / cause.sum()


@cache
def _rated(arm: Arm) -> float:
    """Mass that the arm carries at least, kg."""
    if arm.description in SHIPPED[1:]:
        return rated_payload(arm.description)
    return 1.0


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
        if _effort_share(arm, _model(arm), middle, amplitude, 2.0 * np.pi * frequency) < 0.6:
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


def _effort_share(arm: Arm, model: Model, middle: Array, amplitude: Array, omega: Array) -> float:
    """Largest torque of the motion, as a share of its limit."""
    largest = 0.0
    for t in np.linspace(0.0, 4.0, 25):
        angle = omega * t - 0.5 * np.pi
        q, dq, ddq = middle + amplitude * np.sin(angle), amplitude * omega * np.cos(angle), np.zeros((1, omega.size))
        ddq[0] = -(omega**2) * amplitude * np.sin(angle)
        effort = np.zeros_like(ddq)
        inverse_dynamics(model, q, dq, ddq, effort)
        largest = max(largest, float((np.abs(effort[0]) / arm.limits).max()))
    return largest


@cache
def _model(arm: Arm) -> Model:
    """Its model with the default parameters."""
    return make_model(arm.robot, arm.robot.pack_model(resolve(controller_schema, arm.settings, arm.joints)))


def _controlled(draft: Draft, fits: str = "") -> dict[str, Any]:
    """Choose law and parameters; return their names.

    Args:
        draft: the case.
        fits: hardware that the parameters must fit; empty: any parameters will do.
    """
    random, arm = draft.random, draft.arm
    sets = [PRACTICAL] + (["tuned"] if arm.description in SHIPPED else [])
    chosen = str(random.choice(sets + ([] if fits not in ("", "ideal") else ["default"])))
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
        mass = round(float(random.uniform(0.2, 1.0)) * _rated(draft.arm), 3)
        draft.simulator["payload.mass"] = mass
        _lighten(draft)
        if chosen == "known":
            draft.controller["payload.mass"] = draft.simulator["payload.mass"]


def _lighten(draft: Draft) -> None:
    """Take as much of the payload away as makes the motion possible for the true arm."""
    arm, motion = draft.arm, draft.trajectory
    wave = [np.array(motion[f"reference.{name}"]) for name in ("offset", "amplitude", "frequency")]
    for _ in range(4):
        values = resolve(simulator_schema, {**arm.settings, **draft.simulator}, arm.joints)
        factors = {name: 1.0 + as_float(values[f"model_error.{name}"]) for name in ("mass", "inertia", "length")}
        packed = arm.robot.with_payload(arm.robot.pack_model(values, factors=factors), payload_of(values))
        share = _effort_share(arm, make_model(arm.robot, packed), wave[0], wave[1], 2.0 * np.pi * wave[2])
        if share < _POSSIBLE:
            return
        draft.simulator["payload.mass"] = round(0.5 * draft.simulator["payload.mass"], 3)
    draft.simulator["payload.mass"] = 0.0


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
