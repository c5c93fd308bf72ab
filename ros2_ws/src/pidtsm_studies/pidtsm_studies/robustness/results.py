"""Results of the study: a curve for each contender and imperfection, and the values for each requirement."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pidtsm_core.parameters import Array
from pidtsm_studies.robustness.contenders import Contender
from pidtsm_studies.robustness.imperfections import IMPERFECTIONS, Imperfection
from pidtsm_studies.robustness.requirements import REQUIREMENTS, Requirement

LATE = 10.0
"""Runs are judged from this time on, when the transient is over, s."""
TRACKING = 0.02
"""A run fails if its error reaches this after `LATE`, rad."""
METRICS = ("rmse", "eci", "torque_variation", "late_error")
"""Metrics of the curves; `late_error` is the largest |e| after `LATE`, the others are from `pidtsm_core.metrics`."""
BAND = (5.0, 50.0, 95.0)
"""Percentiles over the seeds: lower edge of the band, curve, upper edge."""
CONFIDENCE = 0.95
"""Confidence level of the (Wilson) interval of a success rate."""


@dataclass(frozen=True)
class Effort:
    """Extent of the study.

    Attributes:
        seeds: number of seeds per value if something is random; otherwise a single run is sufficient.
        values: number of values per imperfection, spread over all its values.
        duration: duration of each run, s; longer than `LATE`.
    """

    seeds: int
    values: int
    duration: float


FULL = Effort(seeds=20, values=20, duration=30.0)
QUICK = Effort(seeds=2, values=2, duration=11.0)


@dataclass(frozen=True)
class Curve:
    """Results of a contender for an imperfection.

    Attributes:
        success: fraction of the runs whose error stays below `TRACKING` and whose torque stays below its limits after
            `LATE`, shape (values,).
        interval: confidence interval of that fraction, low and high, shape (2, values); nan if nothing is random.
        metrics: percentiles `BAND` over the seeds of each of `METRICS`, shape (3, values, joints); inf where a run
            diverged.
    """

    success: Array
    interval: Array
    metrics: Mapping[str, Array]

    @property
    def tolerated(self) -> int:
        """Number of values, from the mildest on, at which every run succeeded."""
        failed = np.flatnonzero(self.success < 1.0)
        return int(failed[0]) if failed.size else self.success.size


@dataclass(frozen=True)
class Achievement:
    """Results of a contender for a requirement.

    Attributes:
        values: measured values by quantity; inf if a run diverged.
        success: fraction of the runs that succeeded.
    """

    values: Mapping[str, float]
    success: float

    def kept(self, requirement: Requirement) -> dict[str, bool]:
        """Whether each limit is met, by quantity."""
        return {quantity: self.values[quantity] <= limit for quantity, limit in requirement.limits.items()}


@dataclass(frozen=True)
class Robustness:
    """The result of the study.

    Attributes:
        effort: extent of the study.
        scenario: of the runs with a single imperfection.
        contenders: in the order of legends.
        runs: number of runs.
        diverged: number of runs that diverged; they count as failed.
        values: tested values of each imperfection.
        curves: curves by imperfection and contender.
        achievements: for each of `REQUIREMENTS`, in their order, the results by contender.
    """

    effort: Effort
    scenario: str
    contenders: Sequence[Contender]
    runs: int
    diverged: int
    values: Mapping[str, tuple[float, ...]]
    curves: Mapping[str, Mapping[str, Curve]]
    achievements: Sequence[Mapping[str, Achievement]]

    def met(self) -> int:
        """Number of requirements of which the first contender meets every limit."""
        pairs = zip(REQUIREMENTS, self.achievements, strict=True)
        return sum(all(by_contender[self.contenders[0].name].kept(each).values()) for each, by_contender in pairs)


def combined(metric: str, values: Array) -> Array:
    """Combine both joints to one number for figures: root of the sum of squares, sum, or maximum.

    Args:
        metric: one of `METRICS`.
        values: shape (..., joints).

    Returns:
        Shape (...).
    """
    if metric == "rmse":
        return np.asarray(np.sqrt(np.sum(values**2, axis=-1)))
    return np.asarray(np.max(values, axis=-1) if metric == "late_error" else np.sum(values, axis=-1))


def as_json(robustness: Robustness) -> dict[str, Any]:
    """Content of robustness.json; values that do not exist or are not finite are null."""
    return {
        "effort": asdict(robustness.effort),
        "runs": robustness.runs,
        "diverged": robustness.diverged,
        "success": {"after": LATE, "error": TRACKING, "confidence": CONFIDENCE},
        "percentiles": list(BAND),
        "scenario": robustness.scenario,
        "contenders": {
            c.name: {"label": c.label, "settings": c.settings(robustness.scenario)["controller"]}
            for c in robustness.contenders
        },
        "rows": [
            _requirement_json(each, by_contender)
            for each, by_contender in zip(REQUIREMENTS, robustness.achievements, strict=True)
        ],
        "imperfections": {each.name: _imperfection_json(each, robustness) for each in IMPERFECTIONS},
    }


def _requirement_json(requirement: Requirement, by_contender: Mapping[str, Achievement]) -> dict[str, Any]:
    return {
        "row": requirement.label,
        "scenarios": [{"scenario": scenario, "set": list(overrides)} for scenario, overrides in requirement.runs],
        "limits": {quantity: _finite_or_none(limit) for quantity, limit in requirement.limits.items()},
        "contenders": {
            name: {
                "values": {quantity: _finite_or_none(value) for quantity, value in each.values.items()},
                "success": each.success,
                "met": each.kept(requirement),
            }
            for name, each in by_contender.items()
        },
    }


def _imperfection_json(imperfection: Imperfection, robustness: Robustness) -> dict[str, Any]:
    return {
        "label": imperfection.label,
        "parameters": list(imperfection.parameters),
        "beside": dict(imperfection.fixed),
        "values": list(robustness.values[imperfection.name]),
        "seeds": robustness.effort.seeds if imperfection.random else 1,
        "contenders": {
            name: {
                "tolerated": curve.tolerated,
                "success": _finite_or_none(curve.success),
                "interval": _finite_or_none(curve.interval),
                "metrics": {metric: _finite_or_none(table) for metric, table in curve.metrics.items()},
            }
            for name, curve in robustness.curves[imperfection.name].items()
        },
    }


def _finite_or_none(values: float | Array) -> Any:
    """For JSON: lists of numbers, with None for values that are not finite."""
    array = np.asarray(values, dtype=np.float64)
    table: Any = array.astype(object)
    table[~np.isfinite(array)] = None
    return table.tolist()
