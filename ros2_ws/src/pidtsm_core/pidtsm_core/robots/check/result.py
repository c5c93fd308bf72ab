"""What `check_arm` finds."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

USED, LOCKED, FIXED = "used", "locked", "fixed"
"""Roles of a joint."""


@dataclass(frozen=True)
class Doubt:
    """Something in a description that looks like a mistake, or that refuses it.

    Attributes:
        code: short name of the mistake, for programs.
        kind: ``joint``, ``link``, or ``arm`` if it concerns the whole description.
        name: of the joint or link; empty for the arm.
        text: what is wrong, with the numbers.
        cure: what to do.
        line: where the element begins in the file; None: it is not known, as in a file that was expanded.
    """

    code: str
    kind: str
    name: str
    text: str
    cure: str
    line: int | None = None

    def __str__(self) -> str:
        of = f"{self.kind} {self.name}: " if self.name else ""
        return f"{of}{self.text}; {self.cure}" if self.cure else of + self.text


@dataclass(frozen=True)
class JointFacts:
    """A joint of a description. Lengths in m, angles in rad; a sliding joint has m, N and kg instead.

    Attributes:
        name: its name.
        role: `USED`, `LOCKED` or `FIXED`.
        reason: why it has this role.
        type: revolute, continuous, prismatic or fixed.
        parent, child: the links that it connects; empty for a closed form.
        axis: in the frame of the joint, shape (3,); empty if it is fixed or the description is a closed form.
        lower, upper: position limits, rad; infinite if there is none.
        velocity, effort: limits, rad/s and N m; infinite if there is none.
        damping, friction: viscous and Coulomb friction, N m s/rad and N m.
        armature: inertia of the rotor as the joint sees it, kg m^2.
        locked_at: position of a locked joint, rad; nan for others.
        line: see `Doubt`.
    """

    name: str
    role: str
    reason: str
    type: str
    parent: str = ""
    child: str = ""
    axis: tuple[float, ...] = ()
    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf
    damping: float = 0.0
    friction: float = 0.0
    armature: float = 0.0
    locked_at: float = math.nan
    line: int | None = None


@dataclass(frozen=True)
class Load:
    """What a used joint carries and accelerates, over the range of the arm.

    Attributes:
        joint: name of the joint.
        gravity: largest effort that holds it at rest, N m or N.
        least_inertia, largest_inertia: smallest and largest inertia that its effort accelerates while the others move
            freely, kg m^2 or kg; infinite for a closed form.
        friction_ratio: share of its velocity that viscous friction takes in one period, where its inertia is least.
    """

    joint: str
    gravity: float
    least_inertia: float
    largest_inertia: float
    friction_ratio: float


@dataclass(frozen=True)
class Mass:
    """What moves with a used joint and not with the next one: a link with all that is fixed to it.

    Attributes:
        joint: name of the joint that moves it.
        links: names of its links.
        mass: kg.
        center: centre of mass from the origin of the joint, in the axes of its frame, whose z axis is the axis of the
            joint, m.
        principal: principal inertias about the centre of mass, ascending, kg m^2.
    """

    joint: str
    links: tuple[str, ...]
    mass: float
    center: tuple[float, ...]
    principal: tuple[float, ...]


@dataclass(frozen=True)
class ArmCheck:
    """What was understood of an arm.

    Attributes:
        source: what was checked.
        file: the file of the description; None: it is a text or a closed form.
        format: URDF, xacro, MJCF or closed form; empty if nothing could be read.
        rate: for which friction was judged, Hz.
        joints: all joints, used ones first and in the order of all arrays.
        loads: of the used joints, in their order; empty if the arm cannot be used.
        masses: likewise; empty for a closed form too.
        base, tool: names of the links; empty if they are not known.
        tool_place: of the tool in the base, with the used joints in the middle of their ranges, shape (3,), m.
        reach: longest way along the links from the base, m; nan if it is not known.
        mimics: by joint, the joint that it mimics.
        refusal: why the arm cannot be used; None: it can.
        doubts: what looks like a mistake.
        notes: what looks like a mistake and does not matter.
    """

    source: str
    file: Path | None
    format: str
    rate: float
    joints: tuple[JointFacts, ...] = ()
    loads: tuple[Load, ...] = ()
    masses: tuple[Mass, ...] = ()
    base: str = ""
    tool: str = ""
    tool_place: tuple[float, ...] = ()
    reach: float = math.nan
    mimics: Mapping[str, str] | None = None
    refusal: Doubt | None = None
    doubts: tuple[Doubt, ...] = ()
    notes: tuple[Doubt, ...] = ()

    @property
    def used(self) -> tuple[JointFacts, ...]:
        """The joints of the arm."""
        return tuple(joint for joint in self.joints if joint.role == USED)

    @property
    def locked(self) -> tuple[JointFacts, ...]:
        """Movable joints that do not move."""
        return tuple(joint for joint in self.joints if joint.role == LOCKED)

    @property
    def fixed(self) -> tuple[JointFacts, ...]:
        """Fixed joints."""
        return tuple(joint for joint in self.joints if joint.role == FIXED)

    def where(self, doubt: Doubt) -> str:
        """File and line of a doubt, as editors understand them; empty if there is no file."""
        if self.file is None:
            return ""
        return str(self.file) if doubt.line is None else f"{self.file}:{doubt.line}"

    def as_json(self) -> dict[str, Any]:
        """All as plain data; what is infinite or unknown is None."""
        found: dict[str, Any] = _plain(asdict(self))
        return {**found, "usable": self.refusal is None}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, Path):
        return str(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value
