"""Hardware, conditions, weights and bounds of the tuner (``tuning.yaml``)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from pidtsm_core.arrays import Array
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_studies.score.tasks import IDEAL, ON_HARDWARE, Task, find_task

_CONTENT: dict[str, Any] = yaml.safe_load(Path(__file__).with_name("tuning.yaml").read_text(encoding="utf-8"))
HARDWARE: Mapping[str, Mapping[str, float]] = _CONTENT["hardware"]
"""Simulator parameters by class of hardware."""
OBJECTIVES: Mapping[str, Mapping[str, float]] = _CONTENT["objectives"]
"""Weights by name, see `objective`."""
MARGINS: Mapping[str, Any] = _CONTENT["margins"]
"""Which of the score's criteria the objective ``robust`` has: ``criteria``, number of ``values``, ``seeds``."""
BOUNDS: Mapping[str, Mapping[str, float]] = _CONTENT["space"]
"""Start and bounds by parameter; what is missing follows from the parameter, see `space`."""
FIXED: tuple[str, ...] = tuple(_CONTENT["fixed"])
"""Parameters that are not tuned."""

PARAMETERS = "params.yaml"
"""The parameter file in the folder of a tuning, which distinguishes one tuning from another."""
NOMINAL = "nominal"
"""The condition of training in which model and load are as the controller knows them."""


def class_of(hardware: str) -> str | None:
    """The class of hardware that a task has for the tuner's hardware of this name; None: it is one of `HARDWARE`."""
    return None if hardware in HARDWARE else hardware


def task_for(robot: str | ArmDefinition, hardware: str) -> Task:
    """The task of an arm on hardware of the tuner, one of `HARDWARE`, or of a class."""
    of_class = class_of(hardware)
    return find_task(robot, of_class, IDEAL if of_class is None else ON_HARDWARE)


def conditions(kind: str, hardware: str, task: Task, limits: Array) -> dict[str, dict[str, Any]]:
    """Simulator parameters of each condition, by name.

    Args:
        kind: ``training`` or ``validation``.
        hardware: one of `HARDWARE`, or the class of hardware of the task, see `class_of`.
        task: of the arm.
        limits: effort limits of its joints, N m or N, shape (joints,).
    """
    found = {}
    for name, content in _CONTENT[kind].items():
        settings = dict(content)
        only = settings.pop("only", HARDWARE)
        if hardware in HARDWARE and hardware not in only:
            continue
        if payload := settings.pop("payload", 0.0):
            settings |= {"payload.mass": payload * task.payload, "payload.time": task.event}
        if friction := settings.pop("friction", 0.0):
            settings["friction.coulomb"] = (friction * limits).tolist()
        found[name] = {**HARDWARE.get(hardware, {}), **settings}
    return found
