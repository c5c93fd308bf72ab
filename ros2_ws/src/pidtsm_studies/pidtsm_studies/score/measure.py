"""Scores a controller: many rollouts, each with one imperfection, and the share of them that succeed."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import Experiment
from pidtsm_core.parameters import names
from pidtsm_core.recording import Recording
from pidtsm_core.recording.metrics import JointMetrics
from pidtsm_core.rollouts.batches import BatchResult, batch
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.rollouts.oracle import ERRORS, oracle
from pidtsm_studies.score.criteria import ROUGHNESS, Criterion, Extent, Range, criteria_of, extent_of, levels_of
from pidtsm_studies.score.plan import Contender, make_plan, repeats_of
from pidtsm_studies.score.results import Curve, Entry, Failure, Outcome
from pidtsm_studies.score.tasks import IDEAL, Task

_WhyFailed = tuple[str, str] | None
"""Joint and reason of `Failure`; None: the run succeeded."""
_NUMBERS = ("rmse", "eci", "torque_variation")
_NUMBERS_ON_HARDWARE = ("transient_rmse", "steady_rmse", "eci", "torque_variation")


ORACLE = "oracle"
"""Name of the controller that no other can beat, see `pidtsm_core.rollouts.oracle`."""
_SPEEDS = (ERRORS[1], ERRORS[0], ERRORS[2])
"""The speeds of the oracle, the one that suits most runs first."""
Metrics: TypeAlias = Mapping[str, list[float]]


class Judged(NamedTuple):
    """A run: how many levels it meets, and why it failed, if it has."""

    met: int
    failed: _WhyFailed


def measure(
    task: Task,
    contender: Contender,
    extent: Extent | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Entry:
    """Run all rollouts on all cores; the same arguments give the same entry, bit by bit.

    Args:
        task: of the arm.
        contender: the controller.
        extent: number of runs; None: all of the edition.
        progress: called regularly with the number of finished runs and the total number.

    Raises:
        UsageError: the controller or the arm is refused; see `Task.experiment`.
    """
    extent = extent or extent_of(task.base, quick=False)
    plan = make_plan(task, contender, extent)
    runs = [*plan.varied, *plan.nominal.values()]
    found = _results(task, contender, [each.experiment for each in runs], plan.limits, progress)
    joints = names(plan.experiment.values["simulator"]["joints"])
    judged = [_judged(task, joints, each) for each in found]
    by_range: dict[tuple[str, str], list[Judged]] = {}
    for run, verdict in zip(plan.varied, judged, strict=False):
        by_range.setdefault(run.key, []).append(verdict)
    first = len(plan.varied)
    return Entry(
        task=task,
        law=ORACLE if contender.oracle else plan.experiment.law,
        name=contender.name or (ORACLE if contender.oracle else plan.experiment.law),
        params=contender.params,
        overrides=contender.overrides,
        extent=extent,
        outcomes=tuple(_outcome(criterion, by_range, extent, task) for criterion in criteria_of(task.base)),
        nominal={name: _numbers(found[first + i], task) for i, name in enumerate(plan.nominal)},
        succeeds={name: judged[first + i].failed is None for i, name in enumerate(plan.nominal)},
        diverged=sum(each is None for each in found),
        runs=len(runs),
        controller={} if contender.oracle else dict(plan.experiment.settings["controller"]),
    )


def _results(
    task: Task,
    contender: Contender,
    experiments: Sequence[Experiment],
    limits: Array,
    progress: Callable[[int, int], None] | None,
) -> list[Metrics | None]:
    """Metrics of each run by name, one value per joint; None: it diverged.

    The oracle is the best of its speeds in each run; those that are left are tried where one misses a level.
    """
    measures = partial(judge, after=task.after, limits=limits)
    speeds: list[dict[str, Any]] = [{"error": error} for error in _SPEEDS] if contender.oracle else [{}]
    found: list[Metrics | None] = [None] * len(experiments)
    left = [*range(len(experiments))]
    for speed in speeds:
        settings = [{"scenario": experiments[i], **speed} for i in left]
        report = partial(_report, progress, len(settings)) if progress else None
        simulate = oracle if contender.oracle else rollout
        result = batch(settings, task.duration, progress=report, measure=measures, simulate=simulate)
        for i, run in zip(left, metrics_of(result, len(settings)), strict=True):
            found[i] = max(found[i], run, key=lambda each: _quality(task, each))
        left = [i for i in left if _quality(task, found[i])[0] < len(levels_of(task))]
    return found


def metrics_of(result: BatchResult, runs: int) -> list[Metrics | None]:
    """Metrics of each run of a batch by name, one value per joint; None: it diverged."""
    return [
        None if run in result.failed else {name: table[run].tolist() for name, table in result.metrics.items()}
        for run in range(runs)
    ]


def _quality(task: Task, found: Metrics | None) -> tuple[int, float]:
    """How good a run is: the levels that it meets, and if none differs, its error."""
    if found is None:
        return 0, -math.inf
    return _met(task, found), -max(found["late_error"])


def _met(task: Task, found: Metrics) -> int:
    """Number of the levels that a run meets."""
    error = max(found["late_error"])
    if not math.isfinite(error) or max(found["roughness"]) > ROUGHNESS:
        return 0
    return sum(error < level for level in levels_of(task))


def judge(run: Recording, after: float, limits: Array) -> JointMetrics:
    """What decides on success, per joint, from `after` (s) on; `limits` are those of the effort, shape (joints,).

    Returns:
        late_error: largest |e|, rad or m; roughness: mean change of the commanded effort from sample to sample,
        divided by the effort limit; transient_rmse, steady_rmse: RMSE before and from `after` on, rad or m.
    """
    late = run.time >= after
    steps = np.abs(np.diff(run.commanded_effort[late], axis=0)).mean(axis=0)
    return {
        "late_error": np.abs(run.error[late]).max(axis=0).tolist(),
        "roughness": (steps / limits).tolist(),
        "transient_rmse": np.sqrt((run.error[~late] ** 2).mean(axis=0)).tolist(),
        "steady_rmse": np.sqrt((run.error[late] ** 2).mean(axis=0)).tolist(),
    }


def _report(progress: Callable[[int, int], None], total: int, done: int) -> None:
    progress(done, total)


def _judged(task: Task, joints: Sequence[str], found: Metrics | None) -> Judged:
    """What a run has met, and why it failed."""
    if found is None:
        return Judged(0, ("", "diverged"))
    beyond = {
        "error": np.array(found["late_error"]) / task.error,
        "roughness": np.array(found["roughness"]) / ROUGHNESS,
    }
    return Judged(_met(task, found), _why(joints, beyond))


def _why(joints: Sequence[str], beyond: Mapping[str, Array]) -> _WhyFailed:
    """Why a run failed whose values, relative to their bounds, are these, each of shape (joints,)."""
    if not all(np.isfinite(each).all() for each in beyond.values()):
        return "", "diverged"
    reason = max(beyond, key=lambda why: float(beyond[why].max()))
    failed = (beyond["error"] >= 1.0).any() or (beyond["roughness"] > 1.0).any()
    return (joints[int(beyond[reason].argmax())], reason) if failed else None


def _outcome(criterion: Criterion, runs: Mapping[tuple[str, str], list[Judged]], extent: Extent, task: Task) -> Outcome:
    return Outcome(criterion, tuple(_curve(criterion, each, runs, extent, task) for each in criterion.ranges))


def _curve(
    criterion: Criterion, each: Range, runs: Mapping[tuple[str, str], list[Judged]], extent: Extent, task: Task
) -> Curve:
    repeats, judged, values = repeats_of(criterion, extent, task), runs[criterion.name, each.label], each.values(extent)
    met = [tuple(run.met for run in judged[i : i + repeats]) for i in range(0, len(judged), repeats)]
    failure = next((Failure(values[i // repeats], *run.failed) for i, run in enumerate(judged) if run.failed), None)
    levels = len(levels_of(task))
    return Curve(
        each,
        tuple(values),
        tuple(sum(each) for each in met),
        repeats * levels,
        failure,
        () if task.base == IDEAL else tuple(met),
        levels,
    )


def _numbers(found: Metrics | None, task: Task) -> dict[str, list[float]] | None:
    """Metrics of a nominal run by name, one value per joint; None if it diverged."""
    if found is None:
        return None
    return {name: found[name] for name in (_NUMBERS if task.base == IDEAL else _NUMBERS_ON_HARDWARE)}
