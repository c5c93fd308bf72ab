"""Robustness of each controller, measured by rollouts with single imperfections and with the requirements' hardware.

A curve belongs to one scenario, by default Case 1: it varies one imperfection and leaves everything else ideal. A
requirement is a scenario with several imperfections.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.stats import binomtest

from pidtsm_core.batches import BatchResult, batch
from pidtsm_core.experiment import Settings
from pidtsm_core.metrics import JointMetrics
from pidtsm_core.parameters import Array
from pidtsm_core.recording import Recording
from pidtsm_core.signals import Signal
from pidtsm_studies.robustness.contenders import CONTENDERS, Contender, for_requirements
from pidtsm_studies.robustness.imperfections import CASE, IMPERFECTIONS, Imperfection
from pidtsm_studies.robustness.requirements import REQUIREMENTS, Requirement
from pidtsm_studies.robustness.results import (
    BAND,
    CONFIDENCE,
    LATE,
    METRICS,
    TRACKING,
    Achievement,
    Curve,
    Effort,
    Robustness,
)

_Condition: TypeAlias = tuple[str, str, int]
"""Contender, imperfection or requirement, index of the value or variant; runs of a condition differ only in seed."""


def measure(
    effort: Effort,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
    contenders: Sequence[Contender] = CONTENDERS,
    scenario: str = CASE,
) -> Robustness:
    """Run all rollouts on all cores.

    Args:
        effort: extent of the study.
        contenders: those to measure, at least one, see `choose`.
        scenario: of the runs with a single imperfection.
        progress: called regularly with the number of finished runs and the total number.
    """
    values = {imperfection.name: _chosen(imperfection.values, effort.values) for imperfection in IMPERFECTIONS}
    conditions, settings = _plan(values, effort.seeds, contenders, scenario)
    result = batch(settings, effort.duration, progress=lambda done: progress(done, len(settings)), measure=_late)
    runs: dict[_Condition, list[int]] = {}
    for run, condition in enumerate(conditions):
        runs.setdefault(condition, []).append(run)
    outcomes = _Outcomes(result, runs)
    return Robustness(
        effort=effort,
        scenario=scenario,
        contenders=contenders,
        runs=len(settings),
        diverged=len(result.failed),
        values=values,
        curves={
            imperfection.name: {
                contender.name: outcomes.curve(contender, imperfection, len(values[imperfection.name]))
                for contender in contenders
            }
            for imperfection in IMPERFECTIONS
        },
        achievements=[
            {contender.name: outcomes.achievement(contender, requirement) for contender in for_requirements(contenders)}
            for requirement in REQUIREMENTS
        ],
    )


def _plan(
    values: Mapping[str, Sequence[float]], seeds: int, contenders: Sequence[Contender], scenario: str
) -> tuple[list[_Condition], list[Settings]]:
    """Condition and parameters of every run."""
    conditions: list[_Condition] = []
    settings: list[Settings] = []

    def add(condition: _Condition, common: Settings, random: bool, more: Mapping[str, float] | None = None) -> None:
        for seed in range(seeds if random else 1):
            conditions.append(condition)
            settings.append({**common, "simulator": {**common["simulator"], **(more or {}), "seed": seed}})

    for contender in contenders:
        ideal = contender.settings(scenario)
        for imperfection in IMPERFECTIONS:
            for index, value in enumerate(values[imperfection.name]):
                condition = (contender.name, imperfection.name, index)
                add(condition, ideal, imperfection.random, imperfection.settings(value))
    for contender in for_requirements(contenders):
        add((contender.name, CASE, 0), contender.settings(CASE), random=False)
        for requirement in REQUIREMENTS:
            for index, (name, overrides) in enumerate(requirement.runs):
                condition = (contender.name, requirement.label, index)
                add(condition, contender.settings(name, overrides), requirement.random)
    return conditions, settings


def _chosen(values: Sequence[float], count: int) -> tuple[float, ...]:
    """`count` of the values, evenly spread, including the first and the last."""
    return tuple(values[round(place)] for place in np.linspace(0, len(values) - 1, min(count, len(values))))


def _late(run: Recording) -> JointMetrics:
    """Criteria of success, per joint: the largest |e| after `LATE`, and the fraction of samples at a torque limit."""
    late = run.time >= LATE
    error = np.abs(run.position[late] - run.reference[late, 0])
    limited = run.signals[late, Signal.SATURATED] != 0.0
    return {"late_error": error.max(axis=0).tolist(), "late_saturation": limited.mean(axis=0).tolist()}


@dataclass(frozen=True)
class _Outcomes:
    """Results of the runs, and the indices of the runs of each condition."""

    result: BatchResult
    runs: Mapping[_Condition, Sequence[int]]

    def of(self, metric: str, condition: _Condition) -> Array:
        """A metric of a condition's runs, shape (runs, joints); inf for a run that diverged."""
        values = self.result.metrics[metric][self.runs[condition]]
        return np.where(np.isnan(values), np.inf, values)

    def succeeded(self, condition: _Condition) -> Array:
        """Whether each of a condition's runs succeeded, shape (runs,)."""
        tracks = self.of("late_error", condition) < TRACKING
        return np.asarray((tracks & (self.of("late_saturation", condition) == 0.0)).all(axis=1))

    def curve(self, contender: Contender, imperfection: Imperfection, values: int) -> Curve:
        conditions = [(contender.name, imperfection.name, index) for index in range(values)]
        successes = [self.succeeded(condition) for condition in conditions]
        intervals = [_interval(each) if imperfection.random else (np.nan, np.nan) for each in successes]
        return Curve(
            success=np.array([each.mean() for each in successes]),
            interval=np.array(intervals).T,
            metrics={metric: self._band(metric, conditions) for metric in METRICS},
        )

    def _band(self, metric: str, conditions: Sequence[_Condition]) -> Array:
        """Percentiles over the runs, shape (3, conditions, joints)."""
        # Each percentile is the value of a run, to avoid interpolation with inf.
        bands = [np.percentile(self.of(metric, each), BAND, axis=0, method="inverted_cdf") for each in conditions]
        return np.stack(bands, axis=1)

    def achievement(self, contender: Contender, requirement: Requirement) -> Achievement:
        conditions = [(contender.name, requirement.label, index) for index in range(len(requirement.runs))]
        ideal = (contender.name, CASE, 0)

        def worst(metric: str, relative: bool = False) -> float:
            means = [self.of(metric, condition).mean(axis=0) for condition in conditions]
            return float(np.max(means / self.of(metric, ideal)[0] if relative else means))

        return Achievement(
            values={
                "rmse": worst("rmse", relative=True),
                "eci": worst("eci", relative=True),
                "late_error": max(float(self.of("late_error", condition).max()) for condition in conditions),
                "torque_variation": worst("torque_variation"),
            },
            success=float(np.concatenate([self.succeeded(condition) for condition in conditions]).mean()),
        )


def _interval(succeeded: Array) -> tuple[float, float]:
    interval = binomtest(int(succeeded.sum()), succeeded.size).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)
