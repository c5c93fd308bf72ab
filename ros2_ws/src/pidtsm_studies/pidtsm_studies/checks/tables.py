"""What was understood of an arm as rows of text, for the page and the terminal."""

import math
from collections.abc import Sequence

from pidtsm_core.robots.check import ArmCheck, JointFacts

JOINTS = ("joint", "type", "axis", "range", "velocity")
"""Columns of `joint_rows`."""
LOADS = ("joint", "effort", "gravity", "share", "inertia", "rotor", "viscous", "Coulomb")
"""Columns of `load_rows`."""
LINKS = ("joint", "moves", "kg", "centre (mm)", "principal inertias")
"""Columns of `link_rows`."""
LOCKED = ("joint", "type", "at", "reason")
"""Columns of `locked_rows`."""
_LARGE = 1000.0
_NOTHING = 1e-9
"""Torque that is rounding, N m."""


def joint_rows(check: ArmCheck) -> list[list[str]]:
    """By used joint: axis in its frame, and limits of the motion."""
    return [
        [joint.name, joint.type, _vector(joint.axis, "{:.3g}"), _range(joint), _number(joint.velocity)]
        for joint in check.used
    ]


def load_rows(check: ArmCheck) -> list[list[str]]:
    """By used joint: effort limit, largest torque of gravity and its share, least inertia, and friction."""
    rows = []
    for joint, load in zip(check.used, check.loads, strict=True):
        gravity = load.gravity if load.gravity > _NOTHING else 0.0
        share = "-" if math.isinf(joint.effort) else f"{100.0 * gravity / joint.effort:.0f} %"
        rotor = f"{joint.armature:.3g}" if joint.armature else "none" if check.masses else "-"
        numbers = (_number(joint.effort), _number(gravity), share, _number(load.least_inertia), rotor)
        rows.append([joint.name, *numbers, _number(joint.damping), _number(joint.friction)])
    return rows


def link_rows(check: ArmCheck) -> list[list[str]]:
    """By used joint: what moves with it, centre of mass from the joint with z along its axis, and inertias."""
    rows = []
    for mass in check.masses:
        more = f" + {len(mass.links) - 1}" if len(mass.links) > 1 else ""
        center = _vector(tuple(1e3 * value for value in mass.center), "{:.0f}")
        principal = _vector(mass.principal, "{:.2g}")
        rows.append([mass.joint, mass.links[0] + more, f"{mass.mass:.3g}", center, principal])
    return rows


def locked_rows(check: ArmCheck) -> list[list[str]]:
    """By joint that can move and does not: its position, and why."""
    return [[joint.name, joint.type, f"{joint.locked_at:.4g}", joint.reason] for joint in check.locked]


def facts(check: ArmCheck) -> list[tuple[str, str]]:
    """What is known of the whole arm."""
    found = [("description", check.format)] if check.format else []
    if check.used:
        found.append(("joints", f"{len(check.used)} used, {len(check.locked)} locked, {len(check.fixed)} fixed"))
        found.append(("used because", check.used[0].reason))
    if check.tool:
        place = _vector(check.tool_place, "{:.3f}")
        found.append(("tool", f"frame of {check.tool}, at {place} m in the middle of all ranges"))
    if check.masses:
        found.append(("moving mass", f"{sum(mass.mass for mass in check.masses):.4g} kg"))
    if math.isfinite(check.reach):
        found.append(("reach", f"{check.reach:.3g} m along the links"))
    if check.loads:
        worst = max(check.loads, key=lambda load: load.friction_ratio)
        of = f" ({worst.joint})" if worst.friction_ratio > 0.0 else ""
        text = f"at most {_number(100.0 * worst.friction_ratio)} % of a joint's velocity is lost in one period{of}"
        found.append((f"viscous friction at {check.rate:g} Hz", text))
    if check.mimics:
        found.append(("mimic joints", ", ".join(f"{one} mimics {other}" for one, other in check.mimics.items())))
    return found


def _range(joint: JointFacts) -> str:
    if joint.type == "continuous":
        return "no limits"
    return f"{joint.lower:.3g} to {joint.upper:.3g}"


def _vector(values: Sequence[float], form: str) -> str:
    """Numbers with spaces between them; a minus before zero is rounding."""
    return (
        " ".join(
            form.format(value).replace("-0", "0") if not float(form.format(value)) else form.format(value)
            for value in values
        )
        or "-"
    )


def _number(value: float) -> str:
    """A limit or torque with three digits, without a power of ten where it is large."""
    if math.isinf(value):
        return "none"
    return f"{value:.3g}" if abs(value) < _LARGE else f"{value:.0f}"
