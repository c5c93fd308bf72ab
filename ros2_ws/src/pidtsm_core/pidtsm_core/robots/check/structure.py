"""The joints of a description: which are used, which do not move, and why."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import numpy as np

from pidtsm_core.robots.chains import HAND
from pidtsm_core.robots.check.elements import Lines
from pidtsm_core.robots.check.result import FIXED, LOCKED, USED, JointFacts
from pidtsm_core.robots.compiler import COUPLE, ON_JOINT, SLIDE, load_mujoco, parse
from pidtsm_core.robots.inertials import Inertial, compile_bodies
from pidtsm_core.robots.tree_robot import TreeRobot


class Structure:
    """The compiled description of an arm."""

    def __init__(self, robot: TreeRobot) -> None:
        self._robot, self._arm = robot, robot.description
        parsed = parse(self._arm.text)
        self._spec, self._limits = parsed.spec, parsed.limits
        self.model, self.inertials = compile_bodies(parsed.spec)
        self._base = parsed.base
        self._names = [self.model.joint(i).name for i in range(self.model.njnt)]
        m = self.model
        self._of_used = [int(m.jnt_bodyid[self._names.index(name)]) for name in robot.joints]
        self._path = {body for used in self._of_used for body in (*self._above(used), used)}

    def mimics(self) -> dict[str, str]:
        """By joint, the joint that it mimics."""
        m, names = self.model, self._names
        pairs = [(m.eq_obj1id[i], m.eq_obj2id[i]) for i in range(m.neq) if m.eq_type[i] == COUPLE]
        return {names[one]: names[other] if other >= 0 else "a constant" for one, other in pairs}

    def joints(self, given: Mapping[str, object], lines: Lines) -> tuple[JointFacts, ...]:
        """All joints: the used ones in the order of the robot, then locked ones, then fixed ones of a URDF.

        Args:
            given: parameters of the robot.
            lines: of the elements.
        """
        used = [self._used(name, j, given) for j, name in enumerate(self._robot.joints)]
        locked = [self._locked(name, given) for name in self._names if name not in self._robot.joints]
        return tuple(
            replace(joint, line=lines.get(("joint", joint.name))) for joint in (*used, *locked, *self._fixed())
        )

    def inertial(self, link: int) -> tuple[Inertial, bool]:
        """Mass of a link of `Description.links`, and whether the description states it."""
        body = self._base + link
        found = self.inertials.get(body)
        if found is None:
            m = self.model
            axes = np.empty(9)
            load_mujoco().mju_quat2Mat(axes, m.body_iquat[body])
            turned = axes.reshape(3, 3)
            inertia = turned @ np.diag(m.body_inertia[body]) @ turned.T
            found = Inertial(float(m.body_mass[body]), m.body_ipos[body].copy(), inertia)
        return found, bool(self._spec.bodies[body].explicitinertial)

    def _used(self, name: str, j: int, given: Mapping[str, object]) -> JointFacts:
        arm = self._arm
        end = arm.links.names[arm.tool_link]
        reason = "chosen" if given.get("joints") else f"in the chain from {arm.links.names[0]} to {end}"
        facts = self._facts(name, USED, reason)
        return replace(
            facts,
            lower=float(arm.lower[j]),
            upper=float(arm.upper[j]),
            velocity=float(arm.velocity[j]),
            effort=float(arm.effort[j]),
        )

    def _locked(self, name: str, given: Mapping[str, object]) -> JointFacts:
        facts = self._facts(name, LOCKED, self._reason(name, given))
        limit = self._limits.get(name, {})
        return replace(
            facts,
            velocity=limit.get("velocity") or math.inf,
            effort=limit.get("effort") or math.inf,
            locked_at=float(self._arm.locked[name]),
        )

    def _facts(self, name: str, role: str, reason: str) -> JointFacts:
        m, i = self.model, self._names.index(name)
        body, dof = int(m.jnt_bodyid[i]), int(m.jnt_dofadr[i])
        limited = bool(m.jnt_limited[i])
        kind = "prismatic" if m.jnt_type[i] == SLIDE else "revolute" if limited else "continuous"
        lower, upper = m.jnt_range[i].tolist() if limited else (-math.inf, math.inf)
        return JointFacts(
            name=name,
            role=role,
            reason=reason,
            type=kind,
            parent=self._link(int(m.body_parentid[body])),
            child=self._link(body),
            axis=tuple(m.jnt_axis[i].round(6).tolist()),
            lower=lower,
            upper=upper,
            damping=float(np.ravel(m.dof_damping[dof])[0]),
            friction=float(m.dof_frictionloss[dof]),
            armature=self._armature(name, float(m.dof_armature[dof])),
        )

    def _armature(self, name: str, of_model: float) -> float:
        if name not in self._robot.joints:
            return of_model
        default = self._robot.parameters[0].default
        return float(default[self._robot.joints.index(name)]) if isinstance(default, tuple) else of_model

    def _reason(self, name: str, given: Mapping[str, object]) -> str:
        """Why a movable joint is not used."""
        if (other := self.mimics().get(name)) is not None:
            return f"mimics {other}"
        if sign := self._arm.grippers.get(name):
            return f"gripper: {sign}"
        m = self.model
        body = int(m.jnt_bodyid[self._names.index(name)])
        driven = {int(joint) for joint in m.actuator_trnid[m.actuator_trntype == ON_JOINT, 0]}
        if driven and not any(self._names.index(each) in driven for each in self._at_or_below(body)):
            return "no motor moves it"
        if body in self._path:
            return "not among the chosen joints" if given.get("joints") else "before the chain"
        branch = next(above for above in self._above(body) if above in self._path or above == 0)
        where = self._link(branch)
        if branch in self._behind_last():
            behind = float(m.body_subtreemass[branch] - m.body_mass[branch])
            arm = float(m.body_subtreemass[self._of_used[0]]) - behind
            return f"gripper, behind {where}" if behind <= HAND * arm else f"behind {where}, where the chain branches"
        return f"on another branch, from {where}"

    def _at_or_below(self, body: int) -> list[str]:
        """The joints of a body and of all bodies that it carries."""
        m = self.model
        return [
            name
            for i, name in enumerate(self._names)
            if (of := int(m.jnt_bodyid[i])) == body or body in self._above(of)
        ]

    def _behind_last(self) -> set[int]:
        """The bodies that the last used joint moves."""
        last = self._of_used[-1]
        return {body for body in range(self.model.nbody) if body == last or last in self._above(body)}

    def _above(self, body: int) -> list[int]:
        """The bodies that carry a body, up to the base, nearest first."""
        found = []
        while body:
            body = int(self.model.body_parentid[body])
            found.append(body)
        return found

    def _link(self, body: int) -> str:
        place = body - self._base
        return self._arm.links.names[place] if place >= 0 else "world"

    def _fixed(self) -> list[JointFacts]:
        """Fixed joints of a URDF; an MJCF has none."""
        if not self._arm.is_urdf:
            return []
        movable, m = set(self._names), self.model
        joints = _joints_of(self._arm.text)
        links = {self._link(body): body for body in range(self._base, m.nbody)}
        found = []
        for name, kind, parent, child in joints:
            if name not in movable:
                moved = self._arm.links.rows[links[child] - self._base] >= 0 if child in links else False
                reason = "fixed, moves with its parent" if moved else "fixed to the base"
                found.append(JointFacts(name, FIXED, reason, kind, parent, child))
        return found


def _joints_of(text: str) -> list[tuple[str, str, str, str]]:
    """Name, type, parent and child of the joints of a URDF."""
    root = ElementTree.fromstring(text)  # noqa: S314  It was read before.
    return [
        (joint.get("name", ""), joint.get("type", ""), _end(joint, "parent"), _end(joint, "child"))
        for joint in root.findall("joint")
    ]


def _end(joint: Any, kind: str) -> str:
    end = joint.find(kind)
    return "" if end is None else str(end.get("link", ""))
