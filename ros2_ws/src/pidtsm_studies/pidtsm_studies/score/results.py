"""Results of a score, and their file."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binomtest

from pidtsm_core.errors import UsageError
from pidtsm_studies.score.criteria import Criterion, Extent, Range, criteria_of
from pidtsm_studies.score.intervals import CONFIDENCE, of_repeats
from pidtsm_studies.score.tasks import IDEAL, Task

FILE = "score.json"


class Failure(NamedTuple):
    """The first run that failed on the way from the first value of a range to the last.

    Attributes:
        value: of the range.
        joint: name of the joint that was the furthest beyond its bound; empty: the run diverged.
        reason: ``error``, ``roughness`` or ``diverged``.
    """

    value: float
    joint: str
    reason: str


@dataclass(frozen=True)
class Curve:
    """Successes over a range.

    Attributes:
        range: what was varied.
        values: shape (values,).
        successes: number of successful runs per value, shape (values,); on hardware of levels that runs meet.
        runs: number of runs per value; on hardware of runs times levels.
        failure: the first one; None: no run failed, or the file of the score lacks it.
        met: on hardware, the number of levels that each run meets, shape (values, runs); () otherwise.
        levels: that a run can meet.
    """

    range: Range
    values: tuple[float, ...]
    successes: tuple[int, ...]
    runs: int
    failure: Failure | None = None
    met: tuple[tuple[int, ...], ...] = ()
    levels: int = 1

    @property
    def share(self) -> float:
        """Share of the runs that succeeded."""
        return sum(self.successes) / (self.runs * len(self.values))


@dataclass(frozen=True)
class Outcome:
    """Result of a criterion; its curves are in the order of its ranges."""

    criterion: Criterion
    curves: tuple[Curve, ...]

    @property
    def share(self) -> float:
        """Mean share of successful runs of the ranges."""
        return math.fsum(curve.share for curve in self.curves) / len(self.curves)

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of the share for other seeds; on hardware also for other motions, see `of_repeats`.

        On ideal hardware it is Wilson's; of no width where nothing is random, as all possible runs were made.
        """
        if all(curve.met for curve in self.curves):
            return of_repeats([np.array(curve.met) / curve.levels for curve in self.curves])
        if not self.criterion.random:
            return self.share, self.share
        runs = sum(curve.runs * len(curve.values) for curve in self.curves)
        successes = sum(sum(curve.successes) for curve in self.curves)
        found = binomtest(successes, runs).proportion_ci(CONFIDENCE, method="wilson")
        return float(found.low), float(found.high)


@dataclass(frozen=True)
class Entry:
    """The score of a controller on an arm.

    Attributes:
        task: what the arm was scored on.
        law: name of the law.
        name: of the controller in tables.
        params, overrides: what the user has chosen, as for `make_experiment`.
        extent: number of runs.
        outcomes: in the order of `criteria_of`.
        nominal: rmse, eci and torque_variation (see `pidtsm_core.recording.metrics.metrics`), one value per joint, of
            the runs ``ideal`` and ``hardware`` (``hardware`` of criteria.yaml); on hardware, of each motion, with
            transient_rmse and steady_rmse (see `judge`) instead of rmse; None if the run diverged.
        succeeds: whether these runs succeeded.
        diverged: number of runs that diverged; they have failed.
        runs: number of all runs.
        controller: parameters of the controller that differ from their defaults.
    """

    task: Task
    law: str
    name: str
    params: tuple[str, ...]
    overrides: tuple[str, ...]
    extent: Extent
    outcomes: tuple[Outcome, ...]
    nominal: Mapping[str, Mapping[str, list[float]] | None]
    succeeds: Mapping[str, bool]
    diverged: int
    runs: int
    controller: Mapping[str, Any]

    @property
    def score(self) -> float:
        """Mean of the criteria's shares, from 0 to 1."""
        return math.fsum(each.share for each in self.outcomes) / len(self.outcomes)

    @property
    def interval(self) -> tuple[float, float]:
        """Confidence interval of the score for other seeds.

        Combined from Wilson's intervals by the method of variance estimates recovery (Zou and Donner 2008, Statistics
        in Medicine 27, 1693-1702): the distances to the limits add up in squares.
        """
        below = math.hypot(*(each.share - each.interval[0] for each in self.outcomes))
        above = math.hypot(*(each.interval[1] - each.share for each in self.outcomes))
        return self.score - below / len(self.outcomes), self.score + above / len(self.outcomes)

    @property
    def worst(self) -> Outcome:
        """Criterion with the lowest share."""
        return min(self.outcomes, key=lambda each: each.share)


def as_json(entry: Entry) -> dict[str, Any]:
    """Content of the file of an entry."""
    return {
        "task": {name: value for name, value in asdict(entry.task).items() if name != "arm"},
        "arm": None if entry.task.arm is None else entry.task.arm.content(),
        "law": entry.law,
        "name": entry.name,
        "params": list(entry.params),
        "set": list(entry.overrides),
        "extent": asdict(entry.extent),
        "score": entry.score,
        "interval": list(entry.interval),
        "confidence": CONFIDENCE,
        "worst": entry.worst.criterion.name,
        "criteria": {
            each.criterion.name: {
                "share": each.share,
                "interval": list(each.interval),
                "runs_per_value": each.curves[0].runs,
                "ranges": {
                    curve.range.label: {
                        "values": list(curve.values),
                        "successes": list(curve.successes),
                        "first_failure": None if curve.failure is None else curve.failure._asdict(),
                        **({"met": [list(each) for each in curve.met], "levels": curve.levels} if curve.met else {}),
                    }
                    for curve in each.curves
                },
            }
            for each in entry.outcomes
        },
        "nominal": dict(entry.nominal),
        "succeeds": dict(entry.succeeds),
        "diverged": entry.diverged,
        "runs": entry.runs,
        "controller": dict(entry.controller),
    }


def read_entry(file: Path) -> Entry:
    """Read what `as_json` describes.

    Raises:
        UsageError: the file is not readable, or of other criteria than those of today.
    """
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        return Entry(
            task=Task(**content["task"]),
            law=content["law"],
            name=content["name"],
            params=tuple(content["params"]),
            overrides=tuple(content["set"]),
            extent=Extent(**content["extent"]),
            outcomes=tuple(
                _outcome(each, content["criteria"][each.name])
                for each in criteria_of(content["task"].get("base", IDEAL))
            ),
            nominal=content["nominal"],
            succeeds=content["succeeds"],
            diverged=content["diverged"],
            runs=content["runs"],
            controller=content["controller"],
        )
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{file} is no score of these criteria ({error!r}); make it anew: ./pidtsm score") from None


def _outcome(criterion: Criterion, content: Mapping[str, Any]) -> Outcome:
    return Outcome(criterion, tuple(_curve(each, content) for each in criterion.ranges))


def _curve(each: Range, content: Mapping[str, Any]) -> Curve:
    of_range, runs = content["ranges"][each.label], content["runs_per_value"]
    # Older files lack it.
    failure = of_range.get("first_failure")
    return Curve(
        each,
        tuple(of_range["values"]),
        tuple(of_range["successes"]),
        runs,
        Failure(**failure) if failure else None,
        tuple(tuple(met) for met in of_range.get("met", ())),
        of_range.get("levels", 1),
    )
