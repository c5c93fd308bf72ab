"""What was understood of an arm, and what in its description looks like a mistake: `check_arm`."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from pidtsm_core.parameters import ParameterError, Value, joint_array
from pidtsm_core.robots import DESCRIPTION, ROBOTS, find_robot, xacro_arguments
from pidtsm_core.robots.base import Robot
from pidtsm_core.robots.check.elements import Lines, file_of, lines_of
from pidtsm_core.robots.check.loads import find_loads, load_doubts
from pidtsm_core.robots.check.masses import find_masses, impossible_links, mass_doubts
from pidtsm_core.robots.check.result import FIXED, LOCKED, USED, ArmCheck, Doubt, JointFacts, Load, Mass
from pidtsm_core.robots.check.structure import Structure
from pidtsm_core.robots.check.written import narrow_doubts, written_doubts
from pidtsm_core.robots.errors import DescriptionError
from pidtsm_core.robots.picture import reach
from pidtsm_core.robots.placement import link_placements
from pidtsm_core.robots.source import read_source
from pidtsm_core.robots.tree_robot import TreeRobot

__all__ = ["FIXED", "LOCKED", "RATE", "USED", "ArmCheck", "Doubt", "JointFacts", "Load", "Mass", "check_arm"]

RATE = 1000.0
"""Rate of the loop for which friction is judged by default, Hz."""
_EFFORT, _ARMATURE = "limits.effort", "robot.armature"
_NO_ROTORS = "no joint has rotor inertia, which behind gears is often more than that of the links (robot.armature)"


def check_arm(settings: Mapping[str, object], rate: float = RATE) -> ArmCheck:
    """Check the arm that parameters choose.

    An arm that cannot be used is a result too, with its `refusal` and with what else looks like a mistake.

    Args:
        settings: parameters of a node; ``joints``, ``limits.effort`` and the groups ``robot`` and ``payload`` matter.
        rate: of the loop, Hz.
    """
    source = str(settings.get(DESCRIPTION.name, DESCRIPTION.default))
    if source in ROBOTS:
        return _closed_form(ROBOTS[source], settings, rate)
    lines = lines_of(source)
    found = ArmCheck(source, file_of(source), "", rate)
    root = _root(source, settings)
    found = replace(found, format=_format(found, root))
    try:
        robot = find_robot(settings)
    except ParameterError as error:
        refusal = _refusal(error, source)
        written = () if root is None or root.tag != "robot" else written_doubts(root, None)
        return replace(found, refusal=_located(refusal, lines), doubts=tuple(_located(each, lines) for each in written))
    assert isinstance(robot, TreeRobot)  # It is neither a closed form nor refused.
    return _checked(found, robot, settings, lines)


def _checked(found: ArmCheck, robot: TreeRobot, settings: Mapping[str, object], lines: Lines) -> ArmCheck:
    """The check of an arm that can be used."""
    arm, structure = robot.description, Structure(robot)
    masses, loads = find_masses(arm), find_loads(robot, settings, found.rate)
    joints = _with_limits(structure.joints(settings, lines), len(robot.joints), settings)
    used = joints[: len(robot.joints)]
    doubts: list[Doubt] = []
    notes: list[Doubt] = []
    if arm.is_urdf:
        doubts += written_doubts(ElementTree.fromstring(arm.text), robot.joints)  # noqa: S314  It was read before.
    else:
        doubts += narrow_doubts(used)
        doubts += [_unlimited(joint) for joint in used if np.isinf(joint.effort)]
    doubts += mass_doubts(arm, masses, structure)
    for doubt, moves in impossible_links(arm, structure):
        (doubts if moves else notes).append(doubt)
    if not any(joint.armature for joint in used):
        notes.append(Doubt("rotors-missing", "arm", "", _NO_ROTORS, ""))
    doubts += load_doubts(used, loads, found.rate)
    if _EFFORT in settings:
        doubts = [each for each in doubts if each.code not in ("effort-missing", "effort-zero")]
    tool = link_placements(arm, np.array(robot.initial_position))[arm.tool_link, :, 3]
    return replace(
        found,
        joints=joints,
        loads=loads,
        masses=masses,
        base=arm.links.names[0],
        tool=arm.links.names[arm.tool_link],
        tool_place=tuple(tool.tolist()),
        reach=reach(arm),
        mimics=structure.mimics(),
        doubts=tuple(_located(each, lines) for each in doubts),
        notes=tuple(_located(each, lines) for each in notes),
    )


def _with_limits(joints: tuple[JointFacts, ...], used: int, settings: Mapping[str, object]) -> tuple[JointFacts, ...]:
    """Joints of which the first, which are used, have the effort limits and rotors of the settings."""
    found = joints[:used]
    if _EFFORT in settings:
        limits = joint_array(_value(settings[_EFFORT]), used)
        found = tuple(replace(each, effort=float(limit)) for each, limit in zip(found, limits, strict=True))
    if _ARMATURE in settings:
        rotors = joint_array(_value(settings[_ARMATURE]), used)
        found = tuple(replace(each, armature=float(rotor)) for each, rotor in zip(found, rotors, strict=True))
    return (*found, *joints[used:])


def _value(given: object) -> Value:
    """A number, or one number per joint."""
    return tuple(float(each) for each in given) if isinstance(given, (list, tuple)) else float(str(given))


def _closed_form(robot: Robot, settings: Mapping[str, object], rate: float) -> ArmCheck:
    loads = find_loads(robot, settings, rate)
    n = len(robot.joints)
    limits = robot.position_limits or [(-np.inf, np.inf)] * n
    joints = tuple(
        JointFacts(
            name=name,
            role=USED,
            reason="in the closed form",
            type="prismatic" if slides else "continuous" if np.isinf(limit).all() else "revolute",
            lower=limit[0],
            upper=limit[1],
            velocity=velocity,
            effort=effort,
            damping=damping,
            friction=friction,
        )
        for name, slides, limit, velocity, effort, damping, friction in zip(
            robot.joints,
            robot.slides or [False] * n,
            limits,
            robot.velocity_limit or [np.inf] * n,
            robot.effort_limit,
            robot.damping or [0.0] * n,
            robot.friction or [0.0] * n,
            strict=True,
        )
    )
    # Its rotors are part of the equations.
    doubts = [each for each in load_doubts(joints, loads, rate) if each.code != "rotor-missing"]
    return ArmCheck(robot.name, None, "closed form", rate, joints, loads, base=robot.base, doubts=tuple(doubts))


def _root(source: str, settings: Mapping[str, object]) -> Element | None:
    """Root element of a description; None if it cannot be read."""
    try:
        return ElementTree.fromstring(read_source(source, xacro_arguments(settings))[1])  # noqa: S314  A robot's own description.
    except (DescriptionError, ElementTree.ParseError, ValueError):
        return None


def _format(found: ArmCheck, root: Element | None) -> str:
    if root is None:
        return ""
    if found.file is not None and found.file.suffix == ".xacro":
        return "xacro"
    return {"robot": "URDF", "mujoco": "MJCF"}.get(root.tag, "")


def _refusal(error: ParameterError, source: str) -> Doubt:
    """A refusal from the message of `find_robot`."""
    text = str(error).removeprefix(f"{DESCRIPTION.name}: ")
    if file_of(source):  # `ArmCheck.where` names it.
        text = text.removeprefix(f"{source}: ")
    element = DescriptionError(text).element
    kind, name = element or ("arm", "")
    return Doubt("refused", kind, name, text.removeprefix(f"{kind} {name}: ") if element else text, "")


def _unlimited(joint: JointFacts) -> Doubt:
    return Doubt(
        "effort-missing",
        "joint",
        joint.name,
        "its motor has no limit, so its effort counts as unlimited",
        "give the motor a ctrlrange, the joint an actuatorfrcrange, or set the parameter limits.effort",
    )


def _located(doubt: Doubt, lines: Mapping[Any, int]) -> Doubt:
    return replace(doubt, line=lines.get((doubt.kind, doubt.name)))
