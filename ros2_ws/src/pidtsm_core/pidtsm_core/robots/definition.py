"""Which arm: its description, and what the user specifies about it."""

import math
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pidtsm_core.errors import UsageError
from pidtsm_core.parameters import did_you_mean
from pidtsm_core.parameters.files import load_mapping
from pidtsm_core.robots import (
    DESCRIPTION,
    LOCKED,
    OF_ARM,
    ROBOTS,
    XACRO,
    Description,
    Robot,
    find_description,
    find_robot,
    has_name,
)
from pidtsm_core.robots.payload import CENTER, MASS, Payload
from pidtsm_core.robots.stored import is_name, stored_file, stored_names
from pidtsm_core.robots.tree_robot import add_load

_SHOWN = 6
"""Locked joints that a sentence names at most."""


@dataclass(frozen=True)
class ArmDefinition:
    """Which arm: for `rollout`, `make_experiment` and every command with ``--robot``.

    Attributes:
        description: a name such as ``panda``, or the path, ``package://`` URI or text of a URDF, xacro or MJCF.
        joints: names of the joints that move, in the order of all arrays; empty: those of the description.
        locked: positions of other joints, by name, rad or m.
        effort: effort limits, N m or N: one for all joints, or one for each, or by name where they differ from those of
            the description; empty: those of the description.
        payload: mass at the tool that the arm carries and the controller knows, kg.
        center_of_mass: of the payload in the tool frame, m.
        xacro: arguments of a xacro file, by name.
        name: under which it is stored; empty: it is not.
    """

    description: str
    joints: tuple[str, ...] = ()
    locked: Mapping[str, float] = field(default_factory=dict)
    effort: Sequence[float] | Mapping[str, float] = ()
    payload: float = 0.0
    center_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0)
    xacro: Mapping[str, str] = field(default_factory=dict)
    name: str = ""

    @property
    def label(self) -> str:
        """How results call it: its name, or its description if that is no text."""
        return self.name or ("arm" if "<" in self.description else self.description)

    @property
    def is_file(self) -> bool:
        """Whether a file or a text describes it, and not a name that this package knows."""
        return not has_name(self.description)

    def settings(self) -> dict[str, Any]:
        """Parameters of simulator and controller that differ from their defaults.

        Raises:
            UsageError: the arm cannot have what is specified.
            ParameterError: see `find_robot`.
        """
        self._check_closed_form()
        found: dict[str, Any] = {DESCRIPTION.name: resolved_description(self.description)}
        if self.joints:
            found["joints"] = list(self.joints)
        if self.locked:
            found[LOCKED.name] = " ".join(f"{name}={value!r}" for name, value in self.locked.items())
        if self.xacro:
            found[XACRO.name] = shlex.join(f"{name}:={value}" for name, value in self.xacro.items())
        if self.effort:
            found["limits.effort"] = self._efforts(find_robot(found))
        if self.payload:
            found[MASS] = self.payload
            if any(self.center_of_mass):
                found[CENTER.name] = list(self.center_of_mass)
        return found

    def robot(self) -> Robot:
        """The model of the arm, without the payload.

        Raises:
            UsageError: see `settings`.
        """
        return find_robot({name: value for name, value in self.settings().items() if name in OF_ARM})

    def with_joints(self) -> "ArmDefinition":
        """The same arm with its joints named, if a file describes it.

        Raises:
            UsageError: see `settings`.
        """
        return self if self.joints or not self.is_file else replace(self, joints=self.robot().joints)

    def in_order(self, joints: Sequence[str]) -> "ArmDefinition":
        """The same arm with its joints in another order; those of a closed form may have other names.

        Raises:
            UsageError: see `settings`.
        """
        known = self.robot().joints
        if set(known) != set(joints):
            return replace(self, joints=tuple(joints))
        efforts = dict(zip(known, self.settings().get("limits.effort", ()), strict=False))
        return replace(self, joints=tuple(joints), effort=efforts)

    def described(self) -> Description:
        """Its description with the payload as a part of the last link.

        Raises:
            UsageError: see `settings`, or it is a closed form without a URDF.
        """
        found = find_description(self.settings())
        if not self.payload:
            return found
        tree = found.tree.copy()
        add_load(found, tree, Payload(self.payload, np.array(self.center_of_mass)))
        return replace(found, tree=tree)

    def content(self) -> dict[str, Any]:
        """The content of its file: everything that is given; plain dictionaries, lists, texts and numbers."""
        given: dict[str, Any] = {
            "description": resolved_description(self.description),
            "joints": list(self.joints),
            "locked": dict(self.locked),
            "effort": dict(self.effort) if isinstance(self.effort, Mapping) else list(self.effort),
            "payload": {"mass": self.payload, "center_of_mass": list(self.center_of_mass)} if self.payload else None,
            "xacro": dict(self.xacro),
        }
        return {key: value for key, value in given.items() if value}

    def words(self) -> list[str]:
        """The equivalent options of a command."""
        if self.name:
            return ["--robot", self.name]
        efforts = (
            [f"{name}={value:g}" for name, value in self.effort.items()]
            if isinstance(self.effort, Mapping)
            else [f"{value:g}" for value in self.effort]
        )
        center = "@" + ",".join(f"{each:g}" for each in self.center_of_mass) if any(self.center_of_mass) else ""
        options = {
            "--robot": self.description,
            "--joints": ",".join(self.joints),
            "--effort": ",".join(efforts),
            "--payload": f"{self.payload:g}{center}" if self.payload else "",
        }
        pairs = [word for option, text in options.items() if text for word in (option, text)]
        pairs += [word for name, value in self.locked.items() for word in ("--lock", f"{name}={value:g}")]
        return pairs + [word for name, value in self.xacro.items() for word in ("--xacro", f"{name}:={value}")]

    def _check_closed_form(self) -> None:
        """Check that a closed form is not given what it cannot have."""
        if self.description not in ROBOTS:
            return
        for what, given in (("locked joints", self.locked), ("xacro arguments", self.xacro)):
            if given:
                raise UsageError(f"{self.description} is a closed form, without {what}")
        if any(self.center_of_mass):
            raise UsageError(f"{self.description} carries a point mass at its tool: give the payload without @x,y,z")

    def _efforts(self, robot: Robot) -> list[float]:
        """Its effort limits, one for each joint of the robot."""
        joints, limits = robot.joints, list(robot.effort_limit)
        if not isinstance(self.effort, Mapping):
            if len(self.effort) not in (1, len(joints)):
                raise UsageError(
                    f"effort: {len(self.effort)} limits for {len(joints)} joints, {', '.join(joints)}; give one for "
                    "all, one for each in this order, or JOINT=LIMIT where it differs from the description"
                )
            return [*self.effort] if len(self.effort) > 1 else [*self.effort] * len(joints)
        for name, value in self.effort.items():
            if name not in joints:
                hint = did_you_mean(name, joints)
                raise UsageError(f"effort: no joint {name} moves; those that do are {', '.join(joints)}{hint}")
            limits[joints.index(name)] = value
        if missing := [name for name, limit in zip(joints, limits, strict=True) if math.isinf(limit)]:
            raise UsageError(f"effort: neither given nor in the description for {', '.join(missing)}")
        return limits


def resolved_description(robot: str) -> str:
    """``robot.description`` for a name, path or text: a path is absolute, because nodes may run in another folder."""
    with suppress(OSError):  # A text is too long for the name of a file.
        if not has_name(robot) and Path(robot).is_file():
            return str(Path(robot).resolve())
    return robot


def find_arm(robot: str | ArmDefinition) -> ArmDefinition:
    """The arm of a name, also one under which the user has stored an arm, or of a path, URI or text.

    Raises:
        UsageError: the file of a stored arm is damaged.
    """
    if isinstance(robot, ArmDefinition):
        return robot
    if has_name(robot) or robot not in stored_names():
        return ArmDefinition(robot)
    file = stored_file(robot)
    return replace(_from_content(load_mapping(file), file), name=robot)


def check_name(name: str) -> None:
    """Check that an arm may be stored under a name.

    Raises:
        UsageError: it is the name of an arm of this package, or not one that a file can have.
    """
    if has_name(name):
        raise UsageError(f"{name} is an arm that comes with pidtsm; choose another name")
    if not is_name(name):
        raise UsageError(
            f"{name!r} is no name for an arm: it must begin with a letter or digit, have at most 64 letters, digits, "
            "_, - and ., and not end as a file of a description does"
        )


def file_content(arm: ArmDefinition) -> str:
    """The text of the file of a stored arm."""
    head = "# An arm that --save NAME has stored and --robot NAME uses. Remove the file to forget it.\n"
    return head + yaml.safe_dump(arm.content(), sort_keys=False)


def _from_content(content: Mapping[str, Any], file: Path) -> ArmDefinition:
    """The arm of a file; see `ArmDefinition.content`."""
    given = dict(content)
    known = ("description", "joints", "locked", "effort", "payload", "xacro")
    if unknown := [str(key) for key in given if key not in known]:
        raise UsageError(f"{file}: unknown key {unknown[0]}; allowed: {', '.join(known)}")
    try:
        if not isinstance(given["description"], str):
            raise TypeError
        payload = given.get("payload", {})
        effort = given.get("effort", [])
        x, y, z = (float(each) for each in payload.get("center_of_mass", (0.0, 0.0, 0.0)))
        return ArmDefinition(
            description=given["description"],
            joints=tuple(str(joint) for joint in given.get("joints", [])),
            locked=_numbers(given.get("locked", {})),
            effort=_numbers(effort) if isinstance(effort, dict) else tuple(float(each) for each in effort),
            payload=float(payload.get("mass", 0.0)),
            center_of_mass=(x, y, z),
            xacro={str(name): str(value) for name, value in given.get("xacro", {}).items()},
        )
    except (KeyError, TypeError, ValueError, AttributeError):
        raise UsageError(
            f"{file} is not of a stored arm; store the arm again with --save, or remove the file"
        ) from None


def _numbers(values: Mapping[Any, Any]) -> dict[str, float]:
    return {str(name): float(value) for name, value in values.items()}


class GripperLockedWarning(UserWarning):
    """A joint of a description was recognised as that of a gripper, and locked, because the user chose no joints."""


def joints_sentence(description: Description, how: str = "--joints and --lock") -> str:
    """Which joints of a description move and which are locked, in one line; `how` are means to choose others."""
    text = f"moves {', '.join(description.joints)}"
    if not description.locked:
        return text
    reasons: dict[str, list[str]] = {}
    for joint, reason in description.grippers.items():
        reasons.setdefault(reason, []).append(joint)
    parts = [f"{_some(joints)} (a gripper: {reason})" for reason, joints in reasons.items()]
    others = [joint for joint in description.locked if joint not in description.grippers]
    parts += [_some(others)] if others else []
    return f"{text}; locks {', '.join(parts)}; choose others with {how}"


def _some(names: Sequence[str]) -> str:
    """Names, of which many are counted."""
    more = f" and {len(names) - _SHOWN} others" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more
