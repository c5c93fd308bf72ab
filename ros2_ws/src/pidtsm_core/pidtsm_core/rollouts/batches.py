"""Many rollouts over varied gains, model errors and seeds, on all cores or, through joblib, on a cluster.

Compiled code releases the GIL, so the workers are threads. A caller can choose another backend::

    with joblib.parallel_config(backend="dask", client=client):
        result = batch(settings, 30.0)
"""

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from joblib import Parallel, delayed

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.parameters import did_you_mean
from pidtsm_core.recording import Recording
from pidtsm_core.recording.latex import cell, escaped, grouped, spread, table
from pidtsm_core.recording.metrics import JointMetrics, metrics
from pidtsm_core.registration.shipment import Parcel, packed, unpack
from pidtsm_core.rollouts.closed_loop import DivergedError, rollout

PRINTED = ("rmse", "max_error", "steady_state_error", "settling_time", "recovery_time", "eci", "torque_variation")
"""Metrics of a table for a paper."""
Settings: TypeAlias = Mapping[str, Any]
"""Arguments of `rollout` by name, without the duration."""
Measure: TypeAlias = Callable[[Recording], JointMetrics]
Simulate: TypeAlias = Callable[..., Recording]
"""What runs one of the settings: `rollout`, or a function with the same results."""


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
        metrics: those of `pidtsm_core.recording.metrics.metrics`, in its units, and of `measure`, by name, each of
            shape (runs, joints); nan if a value does not exist, as for all values of a failed run. Empty if all runs
            failed.
        failed: reason why a run failed, by the number of the run.
        trajectories: one per run (None if it failed) if `keep_every` is positive, otherwise empty.
    """

    metrics: dict[str, Array]
    failed: dict[int, str]
    trajectories: list[Trajectory | None]

    def to_latex(
        self, labels: Sequence[str], metrics: Sequence[str] = PRINTED, joints: Sequence[str] = (), caption: str = ""
    ) -> str:
        """A LaTeX table with booktabs: a column per label, with mean and 95 % interval over its runs.

        Intervals are Student's t over the runs of a label that have the value, which are taken as independent, as with
        different seeds; a single run has none. Values are in SI units.

        Args:
            labels: of each run, such as ``[each["law"] for each in settings]``; equal ones are a group.
            metrics: names in `metrics`, each with a row per joint; those that no run has are left out.
            joints: names of the joints; empty: numbers from 1.
            caption: a comment at the top of the table.

        Raises:
            ValueError: there is not one label for each run.
        """
        runs = len(next(iter(self.metrics.values()))) if self.metrics else len(self.failed)
        if len(labels) != runs:
            raise ValueError(f"labels: {len(labels)} given, but there are {runs} runs")
        groups = grouped(labels)
        rows = []
        for name in (name for name in metrics if name in self.metrics):
            values = self.metrics[name]
            for j in range(values.shape[1]):
                spreads = [spread(values[numbers, j]) for numbers in groups.values()]
                joint = joints[j] if joints else str(j + 1)
                cells = [cell(each.mean, each.half) for each in spreads]
                rows.append([escaped(name.replace("_", " ")) if j == 0 else "", escaped(joint), *cells])
        heads = [f"{escaped(label)} ($n = {len(numbers)}$)" for label, numbers in groups.items()]
        return table(["metric", "joint", *heads], rows, 2, caption)


def batch(
    settings: Iterable[Settings],
    duration: float,
    workers: int = -1,
    progress: Callable[[int], None] | None = None,
    keep_every: int = 0,
    measure: Measure | None = None,
    simulate: Simulate | None = None,
) -> BatchResult:
    """Run one rollout for each of the settings; a failed run is reported and does not affect the others.

    The result does not depend on the number or kind of workers. Memory holds the metrics, the trajectories requested
    and one rollout per worker. An iterator of settings is read only a few settings ahead.

    Args:
        settings: of each run the arguments of `rollout` by name, except `duration`, such as ``{"law": "pid"}``; a run
            with another key fails.
        duration: duration of each run, s.
        workers: number of threads, or of another backend's workers; -1: one per core, -2: one core remains free.
        progress: called repeatedly with the number of finished runs, such as ``print``.
        keep_every: also return every n-th sample of each run; 0 returns none.
        measure: function that returns additional metrics of a run, under names of their own.
        simulate: function that makes a run, whose arguments the settings then are; None: `rollout`.

    Raises:
        ValueError: `keep_every` is negative.
    """
    if keep_every < 0:
        raise ValueError(f"keep_every: {keep_every} must be 0 or positive")
    outcomes: list[_Outcome] = []
    parcels = packed()
    with Parallel(n_jobs=workers, prefer="threads", return_as="generator") as parallel:
        for outcome in parallel(
            delayed(_run)(each, duration, keep_every, measure, simulate or rollout, parcels) for each in settings
        ):
            outcomes.append(outcome)
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
    settings: Settings,
    duration: float,
    keep_every: int,
    measure: Measure | None,
    simulate: Simulate,
    parcels: tuple[Parcel, ...],
) -> _Outcome:
    if reason := _unknown_argument(settings, simulate):
        return _Outcome(failure=reason)
    try:
        unpack(parcels)
        run = simulate(**settings, duration=duration)
    except (UsageError, DivergedError) as reason:
        return _Outcome(failure=str(reason))
    error = run.error
    found = metrics(run.time, error, run.effort, run.saturated, run.event_time)
    if measure is not None:
        found |= measure(run)
    if not keep_every:
        return _Outcome(found)
    kept = slice(None, None, keep_every)
    # Copies: a view would keep the whole rollout.
    return _Outcome(found, Trajectory(run.time[kept].copy(), error[kept].copy(), run.effort[kept].copy()))


def _unknown_argument(settings: Settings, simulate: Simulate) -> str:
    """What is wrong with a key of the settings; empty if nothing is."""
    parameters = inspect.signature(simulate).parameters
    if any(each.kind is each.VAR_KEYWORD for each in parameters.values()):
        return ""
    known = [name for name in parameters if name != "duration"]
    for key in map(str, settings):
        if key not in known:
            return f"unknown argument {key}; known: {', '.join(known)}{did_you_mean(key, known)}"
    return ""


def _table(outcomes: list[_Outcome]) -> dict[str, Array]:
    found = [(i, outcome.metrics) for i, outcome in enumerate(outcomes) if outcome.metrics is not None]
    if not found:
        return {}
    joints = max(len(values["rmse"]) for _, values in found)
    # Only runs with an event have a recovery time.
    names = dict.fromkeys(name for _, values in found for name in values)
    table = {name: np.full((len(outcomes), joints), np.nan) for name in names}
    for i, values in found:
        for name, row in values.items():
            table[name][i, : len(row)] = np.array(row, dtype=np.float64)  # None becomes nan.
    return table
