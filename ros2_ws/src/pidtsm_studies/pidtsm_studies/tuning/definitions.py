"""Hardware, conditions, weights and bounds of the tuner (``tuning.yaml``)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from pidtsm_core.arrays import Array
from pidtsm_studies.score.tasks import Task

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
"""The parameter file in the folder of a tuning, which tells one tuning from another."""
NOMINAL = "nominal"
"""The condition of training in which model and load are as the controller knows them."""


def conditions(kind: str, hardware: str, task: Task, limits: Array) -> dict[str, dict[str, Any]]:
    """Simulator parameters of each condition, by name.

    Args:
        kind: ``training`` or ``validation``.
        hardware: one of `HARDWARE`.
        task: of the arm.
        limits: effort limits of its joints, N m or N, shape (joints,).
    """
    found = {}
    for name, content in _CONTENT[kind].items():
        settings = dict(content)
        if hardware not in settings.pop("only", HARDWARE):
            continue
        if payload := settings.pop("payload", 0.0):
            settings |= {"payload.mass": payload * task.payload, "payload.time": task.event}
        if friction := settings.pop("friction", 0.0):
            settings["friction.coulomb"] = (friction * limits).tolist()
        found[name] = {**HARDWARE[hardware], **settings}
    return found
