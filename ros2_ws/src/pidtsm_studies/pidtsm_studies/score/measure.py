"""Scores a controller: many rollouts, each with one imperfection, and the share of them that succeed."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import Experiment
from pidtsm_core.parameters import names
from pidtsm_core.recording import Recording
from pidtsm_core.recording.metrics import JointMetrics
from pidtsm_core.rollouts.batches import BatchResult, batch
from pidtsm_studies.score.criteria import CRITERIA, FULL, HARDWARE, ROUGHNESS, Criterion, Extent, Range
from pidtsm_studies.score.results import Curve, Entry, Failure, Outcome
from pidtsm_studies.score.tasks import Task, effort_limits

_NOMINAL: dict[str, dict[str, Any]] = {"ideal": {}, "hardware": dict(HARDWARE)}
_WhyFailed = tuple[str, str] | None
"""Joint and reason of `Failure`; None: the run succeeded."""
_NUMBERS = ("rmse", "eci", "torque_variation")


@dataclass(frozen=True)
class Contender:
    """A controller to be scored.

    Attributes:
        law: name of the law; None: that of the parameters, or the default.
        params: parameter sets, as for `make_experiment`.
        overrides: ``NODE.PARAMETER=VALUE``.
        name: name in tables.
    """

    law: str | None
    params: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    name: str = ""


def measure(
    task: Task, contender: Contender, extent: Extent = FULL, progress: Callable[[int, int], None] | None = None
) -> Entry:
    """Run all rollouts on all cores; the same arguments give the same entry, bit by bit.

    Args:
        task: of the arm.
        contender: the controller.
        extent: number of runs.
        progress: called regularly with the number of finished runs and the total number.

    Raises:
        UsageError: the controller or the arm is refused; see `Task.experiment`.
    """
    nominal = task.experiment(contender.law, contender.params, contender.overrides)
    resolved = nominal.values["simulator"]
    limits = effort_limits(resolved)
    for each in (each for criterion in CRITERIA for each in criterion.ranges):
        _ = _with(nominal, each.settings(each.last, 0, task, limits)).values  # Refused: no failed run.
    planned = [*_plan(task, limits, extent)]
    settings = [{"scenario": _with(nominal, changes)} for _, changes in planned]
    settings += [{"scenario": _with(nominal, changes)} for changes in _NOMINAL.values()]
    report = partial(_report, progress, len(settings)) if progress else None
    result = batch(settings, task.duration, progress=report, measure=partial(judge, after=task.after, limits=limits))
    failures = _failures(result, task, names(resolved["joints"]), len(settings))
    runs: dict[tuple[str, str], list[_WhyFailed]] = {}
    for (key, _), failed in zip(planned, failures, strict=False):
        runs.setdefault(key, []).append(failed)
    return Entry(
        task=task,
        law=nominal.law,
        name=contender.name or nominal.law,
        params=contender.params,
        overrides=contender.overrides,
        extent=extent,
        outcomes=tuple(_outcome(criterion, runs, extent) for criterion in CRITERIA),
        nominal={name: _numbers(result, len(planned) + i) for i, name in enumerate(_NOMINAL)},
        succeeds={name: failures[len(planned) + i] is None for i, name in enumerate(_NOMINAL)},
        diverged=len(result.failed),
        runs=len(settings),
        controller=dict(nominal.settings["controller"]),
    )


def judge(run: Recording, after: float, limits: Array) -> JointMetrics:
    """What decides on success, per joint, from `after` (s) on; `limits` are those of the effort, shape (joints,).

    Returns:
        late_error: largest |e|, rad or m; roughness: mean change of the commanded effort from sample to sample,
        divided by the effort limit.
    """
    late = run.time >= after
    steps = np.abs(np.diff(run.commanded_effort[late], axis=0)).mean(axis=0)
    return {"late_error": np.abs(run.error[late]).max(axis=0).tolist(), "roughness": (steps / limits).tolist()}


def _plan(task: Task, limits: Array, extent: Extent) -> Iterator[tuple[tuple[str, str], dict[str, Any]]]:
    """Criterion and range of each run, and its simulator parameters; seeds vary fastest."""
    for criterion in CRITERIA:
        for each in criterion.ranges:
            for value in each.values(extent):
                for seed in range(_repeats(criterion, extent)):
                    yield (criterion.name, each.label), each.settings(value, seed, task, limits)


def _repeats(criterion: Criterion, extent: Extent) -> int:
    return extent.repeats if criterion.random else 1


def _with(nominal: Experiment, changes: dict[str, Any]) -> Experiment:
    simulator = {**nominal.settings["simulator"], **changes}
    return replace(nominal, settings={**nominal.settings, "simulator": simulator})


def _report(progress: Callable[[int, int], None], total: int, done: int) -> None:
    progress(done, total)


def _failures(result: BatchResult, task: Task, joints: Sequence[str], runs: int) -> list[_WhyFailed]:
    """Why each run failed, by the joint that was the furthest beyond its bound; None: it has not."""
    if not result.metrics:
        return [("", "diverged")] * runs
    beyond = {"error": result.metrics["late_error"] / task.error, "roughness": result.metrics["roughness"] / ROUGHNESS}
    return [_why(run in result.failed, joints, {why: each[run] for why, each in beyond.items()}) for run in range(runs)]


def _why(diverged: bool, joints: Sequence[str], beyond: Mapping[str, Array]) -> _WhyFailed:
    """Why a run failed whose values, relative to their bounds, are these, each of shape (joints,)."""
    if diverged or not all(np.isfinite(each).all() for each in beyond.values()):
        return "", "diverged"
    reason = max(beyond, key=lambda why: float(beyond[why].max()))
    failed = (beyond["error"] >= 1.0).any() or (beyond["roughness"] > 1.0).any()
    return (joints[int(beyond[reason].argmax())], reason) if failed else None


def _outcome(criterion: Criterion, runs: Mapping[tuple[str, str], list[_WhyFailed]], extent: Extent) -> Outcome:
    return Outcome(criterion, tuple(_curve(criterion, each, runs, extent) for each in criterion.ranges))


def _curve(
    criterion: Criterion, each: Range, runs: Mapping[tuple[str, str], list[_WhyFailed]], extent: Extent
) -> Curve:
    repeats, why, values = _repeats(criterion, extent), runs[criterion.name, each.label], each.values(extent)
    successes = [why[i : i + repeats].count(None) for i in range(0, len(why), repeats)]
    failure = next((Failure(values[i // repeats], *failed) for i, failed in enumerate(why) if failed), None)
    return Curve(each, tuple(values), tuple(successes), repeats, failure)


def _numbers(result: BatchResult, run: int) -> dict[str, list[float]] | None:
    """Metrics of a nominal run by name, one value per joint; None if it diverged."""
    if run in result.failed:
        return None
    return {name: result.metrics[name][run].tolist() for name in _NUMBERS}
