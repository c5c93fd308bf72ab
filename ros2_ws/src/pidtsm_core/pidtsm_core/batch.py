"""Many rollouts over varied gains, model errors and seeds, on all cores or, through joblib, on a cluster.

Compiled code releases the GIL, so the workers are threads. A caller can choose another backend::

    with joblib.parallel_config(backend="dask", client=client):
        result = batch(settings, 30.0)
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeAlias

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs

from pidtsm_core.metrics import JointMetrics, metrics, tracking_error
from pidtsm_core.parameters import Array, ParameterError
from pidtsm_core.robots import find_robot
from pidtsm_core.rollout import DivergedError, Rollout, rollout
from pidtsm_core.signals import Signal

Settings: TypeAlias = Mapping[str, Mapping[str, Any]]
Measure: TypeAlias = Callable[[Rollout], JointMetrics]

_SHARE = 32
"""Runs per worker between two reports: few enough to show progress, enough to keep all workers busy."""


@dataclass(frozen=True)
class Trajectory:
    """Samples of one run.

    Attributes:
        time: s, shape (samples,).
        error: e = q - q_d, rad or m, shape (samples, joints).
        effort: applied effort, N m or N, shape (samples, joints).
    """

    time: Array
    error: Array
    effort: Array


@dataclass(frozen=True)
class BatchResult:
    """Result of a batch; row i of every array belongs to the i-th settings.

    Attributes:
        metrics: those of `pidtsm_core.metrics.metrics` and of `measure`, by name, each of shape (runs, joints); nan if
            a value does not exist, as for all values of a failed run. Empty if all runs failed.
        failed: reason why a run failed, by the number of the run.
        trajectories: one per run (None if it failed) if `keep_every` is positive, otherwise empty.
    """

    metrics: dict[str, Array]
    failed: dict[int, str]
    trajectories: list[Trajectory | None]


def batch(
    settings: Iterable[Settings],
    duration: float,
    workers: int = -1,
    progress: Callable[[int], None] | None = None,
    event_time: float | None = None,
    keep_every: int = 0,
    measure: Measure | None = None,
) -> BatchResult:
    """Run one rollout for each of the settings; a failed run is reported and does not affect the others.

    The result does not depend on the number or kind of workers. Memory holds the metrics, the trajectories requested
    and one rollout per worker. An iterator of settings is read only a few settings ahead.

    Args:
        settings: settings of each run, see `rollout`.
        duration: duration of each run, s.
        workers: number of threads, or of another backend's workers; -1: one per core, -2: one core remains free.
        progress: called repeatedly with the number of finished runs.
        event_time: time of an event that affects the arm, see `metrics`.
        keep_every: also return every n-th sample of each run; 0 returns none.
        measure: function that returns additional metrics of a run, under names of their own.

    Raises:
        ValueError: `keep_every` is negative.
    """
    if keep_every < 0:
        raise ValueError(f"keep_every: {keep_every} must be 0 or positive")
    waiting = iter(settings)
    outcomes: list[_Outcome] = []
    with Parallel(n_jobs=workers, prefer="threads") as parallel:
        while block := list(islice(waiting, _SHARE * effective_n_jobs(workers))):
            outcomes += parallel(delayed(_run)(each, duration, event_time, keep_every, measure) for each in block)
            if progress is not None:
                progress(len(outcomes))
    return BatchResult(
        metrics=_table(outcomes),
        failed={i: outcome.failure for i, outcome in enumerate(outcomes) if outcome.metrics is None},
        trajectories=[outcome.trajectory for outcome in outcomes] if keep_every else [],
    )


@dataclass(frozen=True)
class _Outcome:
    """Result of a run: metrics, or the reason why there are none."""

    metrics: JointMetrics | None = None
    trajectory: Trajectory | None = None
    failure: str = ""


def _run(
    settings: Settings, duration: float, event_time: float | None, keep_every: int, measure: Measure | None
) -> _Outcome:
    try:
        run = rollout(settings, duration)
    except (ParameterError, DivergedError) as reason:
        return _Outcome(failure=str(reason))
    error = tracking_error(run.position, run.reference[:, 0], find_robot(run.robot).continuous)
    found = metrics(run.time, error, run.effort, run.signals[:, Signal.SATURATED], event_time)
    if measure is not None:
        found |= measure(run)
    if not keep_every:
        return _Outcome(found)
    kept = slice(None, None, keep_every)
    # Copies: a view would keep the whole rollout.
    return _Outcome(found, Trajectory(run.time[kept].copy(), error[kept].copy(), run.effort[kept].copy()))


def _table(outcomes: list[_Outcome]) -> dict[str, Array]:
    found = [(i, outcome.metrics) for i, outcome in enumerate(outcomes) if outcome.metrics is not None]
    if not found:
        return {}
    joints = max(len(values["rmse"]) for _, values in found)
    table = {name: np.full((len(outcomes), joints), np.nan) for name in found[0][1]}
    for i, values in found:
        for name, row in values.items():
            table[name][i, : len(row)] = np.array(row, dtype=np.float64)  # None becomes nan.
    return table
