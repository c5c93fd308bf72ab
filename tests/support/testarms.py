"""Arms with 1, 2, 3 and 7 joints: what tests promise of laws, estimators, drives and faults holds for any number.

The arms with one and three joints exist as texts only, as a user's URDF does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.experiment import practical_settings
from pidtsm_core.experiment.default_motion import default_motion
from pidtsm_core.experiment.node_parameters import controller_node_schema
from pidtsm_core.parameters import Schema, Value, resolve
from pidtsm_core.robots import Model, Robot, find_robot, inverse_dynamics, make_model
from pidtsm_core.robots.tree.layout import Column, rows

UNLIMITED = {"limits.velocity": 0.0, "limits.min_position": 0.0, "limits.max_position": 0.0}
"""Parameters of a controller without the limits of the description: what a test limits, it limits itself."""
ROTOR = 5.0
"""kg m^2 or kg."""
_PID = {"kp": 50.0, "ki": 50.0, "kd": 10.0}
"""Gains of ``pid`` per inertia, similar to the defaults of the two-link arm."""


_PIDDTSM = {
    "law.kp": 8.0,
    "law.ki": 8.0,
    "law.xi": 0.3,
    "law.upsilon": 0.25,
    "law.layer": 0.02,
    "law.gain_maximum": 20.0,
}
"""Gains of the proposed law for joints with little inertia, whatever the estimator."""


@dataclass(frozen=True)
class Arm:
    """An arm, and a motion for it.

    Attributes:
        description: its ``robot.description``.
        start: a posture far from its limits, in which gravity acts, one value per joint, rad or m.
    """

    description: str = field(repr=False)
    start: tuple[float, ...]

    def __str__(self) -> str:
        return f"n{self.joints}"

    @cached_property
    def robot(self) -> Robot:
        return find_robot(self.settings)

    @cached_property
    def settings(self) -> dict[str, Any]:
        """Parameters of a node that choose the arm."""
        return {"robot.description": self.description}

    @cached_property
    def model(self) -> Model:
        """Its model with the default parameters."""
        return make_model(self.robot, self.robot.pack_model(self.values(controller_schema, {})))

    @cached_property
    def free(self) -> Model:
        """A model with its joints but no masses, only rotors of `ROTOR`: joints do not fall, nor move each other."""
        if self.description == "two_link":
            values = self.values(controller_schema, {"robot.m1": 0.0, "robot.m2": 0.0})
            return make_model(self.robot, self.robot.pack_model(values))
        packed = self.robot.pack_model(self.values(controller_schema, {"robot.armature": ROTOR}))
        for row in rows(packed):
            row[Column.MASS : Column.ARMATURE] = 0.0
        return make_model(self.robot, packed)

    @cached_property
    def names(self) -> list[str]:
        return list(self.robot.joints)

    @cached_property
    def joints(self) -> int:
        return len(self.robot.joints)

    @cached_property
    def limits(self) -> Array:
        """Its effort limits, N m or N, shape (joints,)."""
        return np.array(self.robot.effort_limit)

    @cached_property
    def inertia(self) -> Array:
        """What every joint moves at the start while the others hold still, kg m^2 or kg, shape (joints,)."""
        moving = [self.effort(self.start, ddq=unit) - self.effort(self.start) for unit in np.eye(self.joints)]
        return np.diag(moving).copy()

    def weak_limits(self, acceleration: float) -> Array:
        """Effort limits that leave an acceleration (rad/s^2) beside gravity, but at most its own, shape (joints,).

        Those of the two-link arm leave 6.5 rad/s^2.
        """
        gravity = np.abs([self.effort(self.start), self.effort(self.start + self.alternating(1.0))]).max(axis=0)
        return np.minimum(self.limits, gravity + acceleration * self.inertia)

    def alternating(self, value: float) -> Array:
        """The value for the first joint, the opposite for the next one, and so on."""
        return np.resize([value, -value], self.joints)

    def last(self, value: float) -> list[float]:
        """The value for the last joint, and another one for the others."""
        return [*[0.8 * value] * (self.joints - 1), value]

    def spread(self, first: float, last: float) -> list[float]:
        """A value for every joint, from that of the first to that of the last one."""
        return np.linspace(first, last, self.joints).tolist()

    def values(self, schema: Schema, settings: Mapping[str, object]) -> dict[str, Value]:
        """Parameters of a node that has this arm."""
        free = UNLIMITED if schema in (controller_schema, controller_node_schema) else {}
        return resolve(schema, {**self.settings, **free, **settings}, self.joints)

    def controller(self, **changes: object) -> Controller:
        """A controller; parameter names with two underscores instead of the dot."""
        return Controller(self.values(controller_schema, dotted(changes)))

    def gains(self, law: str = "piddtsm") -> dict[str, Any]:
        """Gains for the inertia of its joints where the defaults, which are those of the two-link arm, do not fit."""
        if self.description == "two_link":
            return {}
        if law in ("time_delay", "disturbance_observer"):
            return {"law.inertia": (0.2 * self.inertia).tolist()}
        if law == "pid":
            return {f"law.{gain}": (share * self.inertia).tolist() for gain, share in _PID.items()}
        if law != "piddtsm":
            return {}
        return dict(_PIDDTSM)

    @cached_property
    def practical(self) -> dict[str, Any]:
        """Parameters of a controller for encoders, delays and a roughly correct model."""
        return practical_settings(None, {"simulator": {}, "controller": self.settings})["controller"]

    def motion(self, near: bool = False) -> dict[str, Any]:
        """Settings of all nodes for a motion from rest: Case 1, which begins beside its reference unless it is to begin
        `near` it, or the default motion."""
        if self.description == "two_link":
            motion = {"simulator": {"initial_position": [0.4, -0.02]}} if near else {}
        else:
            motion = default_motion(self.robot)
        return {
            "simulator": {**self.settings, **motion.get("simulator", {})},
            "controller": {**self.settings, **UNLIMITED},
            "trajectory": motion.get("trajectory", {}),
        }

    def effort(self, q: Array | Sequence[float], dq: Array | float = 0.0, ddq: Array | float = 0.0) -> Array:
        """Effort for this motion, by default that which carries the arm at rest, N m or N, shape (joints,)."""
        zero, effort = np.zeros(self.joints), np.zeros((1, self.joints))
        inverse_dynamics(self.model, np.array(q), zero + dq, (zero + ddq)[np.newaxis], effort)
        return effort[0]


def dotted(changes: Mapping[str, object]) -> dict[str, object]:
    """Parameters whose names have two underscores instead of the dot."""
    return {name.replace("__", "."): value for name, value in changes.items()}


def _link(name: str, mass: float, centre: str, inertia: tuple[float, float, float]) -> str:
    xx, yy, zz = inertia
    return (
        f'<link name="{name}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
        f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def _joint(name: str, kind: str, ends: tuple[str, str], place: tuple[str, str], limit: str, rotor: float) -> str:
    """A joint between the links `ends`; `place`: its origin and its axis."""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{ends[0]}"/><child link="{ends[1]}"/>'
        f'<origin xyz="{place[0]}"/><axis xyz="{place[1]}"/><limit {limit}/></joint>'
        f'<transmission name="{name}_drive"><joint name="{name}"/><actuator name="{name}_motor">'
        f'<drake:rotor_inertia value="{rotor}"/></actuator></transmission>'
    )


def _urdf(*parts: str, tool: tuple[str, str]) -> str:
    """The links and joints, and a tool: the link that carries it, and its origin."""
    return (
        f'<robot name="arm" xmlns:drake="http://drake.mit.edu"><link name="base"/>{"".join(parts)}<link name="tool"/>'
        f'<joint name="mount" type="fixed"><parent link="{tool[0]}"/><child link="tool"/><origin xyz="{tool[1]}"/>'
        "</joint></robot>"
    )


_PENDULUM = _urdf(
    _link("rod", 4.0, "0.4 0 0", (0.01, 0.1, 0.1)),
    _joint(
        "swing",
        "revolute",
        ("base", "rod"),
        ("0 0 1", "0 1 0"),
        'lower="-2" upper="2" effort="60" velocity="3"',
        0.2,
    ),
    tool=("rod", "0.7 0 0"),
)
# The joints move 15 kg, 0.9 kg m^2 and 0.03 kg m^2.
_CRANE = _urdf(
    _link("carriage", 8.0, "0 0 0.1", (0.1, 0.1, 0.05)),
    _link("boom", 3.0, "0.3 0 0", (0.02, 0.1, 0.1)),
    _link("hook", 0.8, "0.12 0 0.02", (0.002, 0.004, 0.004)),
    _joint(
        "lift",
        "prismatic",
        ("base", "carriage"),
        ("0 0 0", "0 0 1"),
        'lower="-0.1" upper="0.7" effort="400" velocity="0.8"',
        5.0,
    ),
    _joint(
        "tilt",
        "revolute",
        ("carriage", "boom"),
        ("0.1 0 0", "0 1 0"),
        'lower="-1.5" upper="1" effort="60" velocity="2.5"',
        0.3,
    ),
    _joint(
        "turn",
        "revolute",
        ("boom", "hook"),
        ("0.6 0 0", "0 1 0.5"),
        'lower="-2" upper="2" effort="10" velocity="4"',
        0.02,
    ),
    tool=("hook", "0.2 0 0.05"),
)
TURNTABLE = _urdf(
    _link("table", 4.0, "0.1 0 0.1", (0.1, 0.1, 0.1)),
    _link("boom", 2.0, "0.2 0 0", (0.02, 0.05, 0.05)),
    _joint("joint1", "continuous", ("base", "table"), ("0 0 0", "0 0 1"), 'effort="60" velocity="3"', 0.1),
    _joint(
        "joint2",
        "revolute",
        ("table", "boom"),
        ("0.1 0 0.2", "0 1 0"),
        'lower="-1.5" upper="1" effort="60" velocity="2.5"',
        0.1,
    ),
    tool=("boom", "0.4 0 0"),
)
"""Two joints, the first of which turns without end."""

PENDULUM = Arm(_PENDULUM, (0.3,))
TWO_LINK = Arm("two_link", (0.2, -0.1))
CRANE = Arm(_CRANE, (0.3, -0.3, 0.2))
PANDA = Arm("panda", (0.1, 0.4, -0.2, -1.6, 0.3, 1.8, 0.1))

ARMS = (PENDULUM, TWO_LINK, CRANE, PANDA)
