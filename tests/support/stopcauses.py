"""What makes a controller stop, for random cases; see `stopcases`."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.control import controller_schema
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import as_float, resolve
from pidtsm_core.robots import Model, inverse_dynamics, make_model
from pidtsm_core.robots.payload import payload_of
from pidtsm_core.robots.source import rated_payload
from pidtsm_core.simulation.simulator import simulator_schema
from support.stoploop import Kind
from support.testarms import Arm

Random = np.random.Generator
Event = tuple[str, int, float, float, float]
"""Name of the `Kind`, joint, begin (s), duration (s; 0: one sample), size."""

SHIPPED = ("two_link", "scara", "ur5", "panda", "xarm7", "z1")
_PUSHED = 0.2
"""Longest push, where nothing else is said, s."""
_POSSIBLE = 0.85
"""Largest share of a torque limit that the true arm with its payload needs."""
FOREVER = 100.0
"""s."""


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
        inertia = self.arm.robot.joint_inertia(model_of(self.arm).parameters, q)[self.joint]
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


def effort_share(arm: Arm, model: Model, middle: Array, amplitude: Array, omega: Array) -> float:
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
def model_of(arm: Arm) -> Model:
    """Its model with the default parameters."""
    return make_model(arm.robot, arm.robot.pack_model(resolve(controller_schema, arm.settings, arm.joints)))


@cache
def rated(arm: Arm) -> float:
    """Mass that the arm carries at least, kg."""
    if arm.description in SHIPPED[1:]:
        return rated_payload(arm.description)
    return 1.0


def lighten(draft: Draft) -> None:
    """Take as much of the payload away as makes the motion possible for the true arm."""
    arm, motion = draft.arm, draft.trajectory
    wave = [np.array(motion[f"reference.{name}"]) for name in ("offset", "amplitude", "frequency")]
    for _ in range(4):
        values = resolve(simulator_schema, {**arm.settings, **draft.simulator}, arm.joints)
        factors = {name: 1.0 + as_float(values[f"model_error.{name}"]) for name in ("mass", "inertia", "length")}
        packed = arm.robot.with_payload(arm.robot.pack_model(values, factors=factors), payload_of(values))
        share = effort_share(arm, make_model(arm.robot, packed), wave[0], wave[1], 2.0 * np.pi * wave[2])
        if share < _POSSIBLE:
            return
        draft.simulator["payload.mass"] = round(0.5 * draft.simulator["payload.mass"], 3)
    draft.simulator["payload.mass"] = 0.0


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
    mass = round(float(draft.random.uniform(0.5, 1.0)) * rated(draft.arm), 3)
    draft.simulator |= {"payload.mass": mass, "payload.time": draft.at}
    lighten(draft)
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
