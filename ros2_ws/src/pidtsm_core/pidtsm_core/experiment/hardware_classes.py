"""Classes of hardware: sensors, drives and gears of a kind of arm, as parameters of the simulator."""

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_core.parameters import did_you_mean
from pidtsm_core.parameters.files import flatten, load_mapping
from pidtsm_core.robots import find_robot

_FOLDER = Path(__file__).with_name("hardware")
_ELASTICITY = "elasticity."


def hardware_names() -> list[str]:
    """Names of the classes included in the package."""
    return sorted(file.stem for file in _FOLDER.glob("*.yaml"))


def hardware_description(name: str) -> str:
    """What a class is, in one line."""
    return str(hardware_content(name)["description"])


def hardware_settings(name: str, simulator: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of the simulator of an arm with hardware of a class.

    What a file has as ``relative`` is per N m (N) of the effort limit of each joint. Joints that slide stay rigid.

    Args:
        name: one of `hardware_names`.
        simulator: parameters of the simulator that choose the arm and its effort limits.

    Raises:
        UsageError: there is no such class, or (`ParameterError`) the arm cannot be used.
    """
    content, robot = hardware_content(name), find_robot(simulator)
    limits = simulator.get("limits.effort", robot.effort_limit)
    each = list(limits) if isinstance(limits, (list, tuple)) else [limits] * len(robot.joints)
    settings = flatten(content["simulator"], f"{name}: simulator")
    for parameter, share in flatten(content.get("relative") or {}, f"{name}: relative").items():
        slides = robot.slides if parameter.startswith(_ELASTICITY) and robot.slides else [False] * len(each)
        settings[parameter] = [0.0 if slide else share * limit for limit, slide in zip(each, slides, strict=True)]
    return settings


@functools.cache
def hardware_content(name: str) -> dict[str, Any]:
    """The file of a class: ``description``, ``simulator``, ``relative``.

    Raises:
        UsageError: there is no such class.
    """
    if name not in hardware_names():
        known = hardware_names()
        raise UsageError(f"no hardware {name}: it must be one of {', '.join(known)}{did_you_mean(name, known)}")
    return load_mapping(_FOLDER / f"{name}.yaml")
