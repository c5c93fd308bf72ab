"""What a person agrees to before a step: its plan in words and figures, the same at a terminal and on a page."""

from collections.abc import Mapping
from typing import Any

from pidtsm_core.robots import find_robot
from pidtsm_studies.commissioning.bench import Plan
from pidtsm_studies.commissioning.session import NAMES, TITLES

HEADINGS = ("joint", "moves at most", "torque at most")
"""Of `rows`."""
QUESTION = "Does the arm have room, and is a hand at the emergency stop?"


def heading(step: str) -> str:
    """Number and title of a step."""
    return f"{NAMES.index(step) + 1} of {len(NAMES)}: {TITLES[step]}"


def rows(plan: Plan, arm: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Joint, farthest way and largest torque of a plan, in words, for each joint; `arm`: parameters that choose it."""
    robot = find_robot(arm)
    return [
        (joint, f"{travel:.3f} {unit.position}", f"{effort:.3g} {unit.effort}")
        for joint, unit, travel, effort in zip(robot.joints, robot.units, plan.travel, plan.effort, strict=True)
    ]
