"""Doubts about the numbers that are written in a description."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any
from xml.etree.ElementTree import Element

from pidtsm_core.robots.check.result import Doubt, JointFacts

_TURN = 2.0 * math.pi
_ROUNDING = 1.001
"""A limit of 6.29 rad is still one turn."""
_FAST = {"revolute": 60.0, "continuous": 60.0, "prismatic": 20.0}
"""Velocity limits beyond which no joint of an arm goes, rad/s and m/s."""
_LONG = 10.0
"""Limit of a sliding joint beyond that of arms, m."""
_STILL = 0.01
"""Velocity limit below which no joint of an arm can do its work, rad/s or m/s."""
_STAND_IN, _NO_LIMIT = 100.0, 1000.0
"""Velocity limits that are meant as none: this one, and all from this one on."""
_FAR = 5.0
"""Distance of a joint from the one before it that no arm has, m."""
_NARROW = 0.11
"""Range of a joint of an MJCF below which radians were probably read as degrees, rad: a whole turn would be 0.1097."""


def written_doubts(root: Element, joints: Sequence[str] | None) -> Iterator[Doubt]:
    """Doubts about the joints of a URDF.

    Args:
        root: the URDF; it need not be usable.
        joints: names of the joints that move; None: all that can.
    """
    for joint in root.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type", "")
        yield from _origin_doubts(joint, name)
        if kind not in _FAST or (joints is not None and name not in joints):
            continue
        if joint.find("axis") is None:
            yield Doubt(
                "axis-missing",
                "joint",
                name,
                "it has no axis, so it moves about or along x, which is URDF's default",
                'write its axis, such as <axis xyz="0 0 1"/>',
            )
        limit = joint.find("limit")
        numbers = {} if limit is None else {key: _number(value) for key, value in limit.attrib.items()}
        yield from _limit_doubts(name, kind, numbers)


def _origin_doubts(joint: Element, name: str) -> Iterator[Doubt]:
    origin = joint.find("origin")
    xyz, rpy = ([_number(word) for word in ("" if origin is None else origin.get(key, "")).split()] for key in _ORIGIN)
    if any(abs(value) > _FAR for value in xyz):
        yield Doubt(
            "origin-far",
            "joint",
            name,
            f"its origin is {max(map(abs, xyz)):g} m away from its parent link",
            "write metres, if these are millimetres",
        )
    if any(abs(value) > _ROUNDING * _TURN for value in rpy):
        yield Doubt(
            "origin-degrees",
            "joint",
            name,
            f"rpy of its origin is {' '.join(f'{value:g}' for value in rpy)} rad, more than a turn",
            "write radians, if these are degrees",
        )


_ORIGIN = ("xyz", "rpy")


def _limit_doubts(name: str, kind: str, limit: Mapping[str, float]) -> Iterator[Doubt]:
    """Doubts about the element ``limit`` of a joint that moves."""
    if kind == "revolute":
        yield from range_doubts(name, limit.get("lower", 0.0), limit.get("upper", 0.0))
    missing = [key for key in ("lower", "upper") if key not in limit]
    if missing and kind != "continuous":
        meaning = "it moves without limits" if len(missing) > 1 else "it counts as 0"
        yield Doubt(
            "limits-missing",
            "joint",
            name,
            f"its limit has no {' and no '.join(missing)}, so {meaning}",
            f"write {' and '.join(missing)}, or make the joint continuous if it turns without end",
        )
    stroke = max(abs(limit.get("lower", 0.0)), abs(limit.get("upper", 0.0)))
    if kind == "prismatic" and _LONG < stroke < math.inf:
        yield Doubt(
            "limits-millimetres",
            "joint",
            name,
            f"its limits are {limit.get('lower', 0.0):g} to {limit.get('upper', 0.0):g} m",
            "write metres, if these are millimetres",
        )
    for key, unit in (("velocity", "rad/s" if kind != "prismatic" else "m/s"), ("effort", "")):
        if not limit.get(key):
            state = "is 0" if key in limit else "is missing"
            yield Doubt(
                f"{key}-{'zero' if key in limit else 'missing'}",
                "joint",
                name,
                f"its {key} limit {state}, so it counts as unlimited",
                f"write that of its motor, or set the parameter limits.{key}",
            )
        elif key == "velocity" and 0.0 < limit[key] < _STILL:
            text = f"its velocity limit is {limit[key]:g} {unit}, slower than joints of arms"
            yield Doubt("velocity-small", "joint", name, text, f"correct it, in {unit}")
        elif key == "velocity" and _FAST[kind] < limit[key] < _NO_LIMIT and limit[key] != _STAND_IN:
            wrong = "degrees per second" if kind != "prismatic" else "millimetres per second"
            yield Doubt(
                "velocity-large",
                "joint",
                name,
                f"its velocity limit is {limit[key]:g} {unit}, faster than joints of arms",
                f"write {unit}, if these are {wrong}",
            )


def range_doubts(name: str, lower: float, upper: float) -> Iterator[Doubt]:
    """Doubts about the limits of a joint that turns, rad."""
    for value in (lower, upper):
        # Some wrists turn twice, but not by whole numbers of radians.
        turns = 1.0 if value.is_integer() else 2.0
        if math.isfinite(value) and abs(value) > _ROUNDING * _TURN * turns:
            in_degrees = abs(value) <= 720.0
            yield Doubt(
                "limits-degrees" if in_degrees else "limits-wide",
                "joint",
                name,
                f"its limits are {lower:g} to {upper:g} rad, {abs(value) / _TURN:.3g} turns",
                f"write radians, if these are degrees ({math.radians(lower):.4g} to {math.radians(upper):.4g})"
                if in_degrees
                else "a joint without limits is continuous",
            )
            return


def narrow_doubts(joints: Sequence[JointFacts]) -> Iterator[Doubt]:
    """Doubts about the ranges of an MJCF, where angles are degrees unless it chooses radians."""
    for joint in joints:
        if joint.type == "revolute" and joint.upper - joint.lower < _NARROW:
            low, high = math.degrees(joint.lower), math.degrees(joint.upper)
            yield Doubt(
                "limits-narrow",
                "joint",
                joint.name,
                f"its range is only {low:.3g} to {high:.3g} degrees",
                'if these are radians, write <compiler angle="radian"/>',
            )
        elif joint.type == "revolute":
            yield from range_doubts(joint.name, joint.lower, joint.upper)


def _number(text: Any) -> float:
    with suppress(TypeError, ValueError):
        return float(text)
    return math.nan
