"""What the score varies: ranges of one parameter each, around ideal hardware or the arm's own (two editions)."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pidtsm_core.arrays import Array
from pidtsm_studies.score.tasks import ON_HARDWARE, Task

_CONTENT: dict[str, Any] = yaml.safe_load(Path(__file__).with_name("criteria.yaml").read_text(encoding="utf-8"))
ROUGHNESS: float = _CONTENT["roughness"]
"""Largest mean change of the commanded effort from sample to sample, as a share of its limit."""
HARDWARE: Mapping[str, float] = _CONTENT["hardware"]
"""Simulator parameters of the second nominal run."""
_SECOND: dict[str, Any] = yaml.safe_load(Path(__file__).with_name("hardware_base.yaml").read_text(encoding="utf-8"))
LEVELS: tuple[float, ...] = tuple(_SECOND["levels"])
"""Bounds of the error that a run of the second edition may meet, rad or m."""
_PUSH = 0.1
"""Duration of a push, s."""


@dataclass(frozen=True)
class Extent:
    """How many runs a score takes.

    Attributes:
        values: number of values of each range, spread over all of them.
        repeats: number of seeds per value where something is random.
    """

    values: int = _CONTENT["values"]
    repeats: int = _CONTENT["repeats"]


FULL, QUICK = Extent(), Extent(values=3, repeats=1)
FULL_ON_HARDWARE, QUICK_ON_HARDWARE = Extent(_SECOND["values"], _SECOND["repeats"]), Extent(values=3, repeats=1)


@dataclass(frozen=True)
class Range:
    """Values of parameters of the simulator.

    Attributes:
        label: what is varied.
        unit: of the values.
        parameters: which have the same value.
        first, last: ends of the range; the order of the values.
        relative_to: what a value is a share of: ``effort`` (the limit of each joint), ``push`` (that of the joint
            which is pushed), ``payload`` (the largest of the arm); empty: it is absolute. `variations` has those of the
            second edition.
        spacing: ``linear`` or ``logarithmic``.
    """

    label: str
    unit: str
    parameters: tuple[str, ...]
    first: float
    last: float
    relative_to: str = ""
    spacing: str = "linear"

    @property
    def logarithmic(self) -> bool:
        """Whether the values are spaced by a factor."""
        return self.spacing == "logarithmic"

    def values(self, extent: Extent) -> list[float]:
        """The values; integers if both ends are."""
        spread = np.geomspace if self.logarithmic else np.linspace
        whole = isinstance(self.first, int) and isinstance(self.last, int)
        return [round(v) if whole else float(f"{v:.4g}") for v in spread(self.first, self.last, extent.values)]

    def settings(self, value: float, seed: int, task: Task, limits: Array) -> dict[str, Any]:
        """Parameters of the simulator.

        Args:
            value: one of `values`.
            seed: of what is random.
            task: of the arm.
            limits: effort limits of the simulated arm, N m, shape (joints,).
        """
        if self.relative_to == "push":
            random = np.random.default_rng(seed)
            joint, sign = random.integers(limits.size), random.choice([-1.0, 1.0])
            effort = np.where(np.arange(limits.size) == joint, sign * value * limits, 0.0)
            begin = task.event + random.uniform()
            return {"push.effort": effort.tolist(), "push.time": begin, "push.duration": _PUSH}
        if self.relative_to == "payload":
            return {"payload.mass": value * task.payload, "payload.time": task.event}
        scaled = (value * limits).tolist() if self.relative_to == "effort" else value
        return {**dict.fromkeys(self.parameters, scaled), "seed": seed}


@dataclass(frozen=True)
class Criterion:
    """A share of the score: the mean share of successful runs over its ranges.

    Attributes:
        name: name in results.
        label: what it is.
        ranges: which are varied one at a time.
        random: whether the seed matters.
    """

    name: str
    label: str
    ranges: tuple[Range, ...]
    random: bool


def _criterion(name: str, content: Mapping[str, Any]) -> Criterion:
    ranges = (
        Range(**{"label": content["label"], **each, "parameters": tuple(each["parameters"])})
        for each in content["ranges"]
    )
    return Criterion(name, content["label"], tuple(ranges), content.get("random", False))


CRITERIA = tuple(_criterion(name, content) for name, content in _CONTENT["criteria"].items())
"""In the order of tables."""
CRITERIA_ON_HARDWARE = tuple(_criterion(name, content) for name, content in _SECOND["criteria"].items())
"""Likewise, of the second edition."""


def criteria_of(base: str) -> tuple[Criterion, ...]:
    """The criteria of the edition with this base, one of `BASES`."""
    return CRITERIA_ON_HARDWARE if base == ON_HARDWARE else CRITERIA


def levels_of(task: Task) -> tuple[float, ...]:
    """Bounds of the error that a run may meet, rad or m."""
    return LEVELS if task.base == ON_HARDWARE else (task.error,)


def extent_of(base: str, quick: bool) -> Extent:
    """The number of runs of an edition; `quick`: only a few."""
    if base == ON_HARDWARE:
        return QUICK_ON_HARDWARE if quick else FULL_ON_HARDWARE
    return QUICK if quick else FULL
