"""What the tuner minimises: tracking, a smooth torque, distance from the limits, and success, under every condition."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.control import LAW_NAME
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import PRACTICAL, Experiment
from pidtsm_core.recording import Recording
from pidtsm_core.recording.metrics import JointMetrics
from pidtsm_core.rollouts.batches import batch
from pidtsm_core.rollouts.oracle import ERRORS, oracle
from pidtsm_studies.score.criteria import CRITERIA, ROUGHNESS, Extent
from pidtsm_studies.score.measure import ORACLE, judge, metrics_of
from pidtsm_studies.score.tasks import Task, effort_limits
from pidtsm_studies.tuning.definitions import MARGINS, OBJECTIVES, conditions

RULE = "rule"
"""The rule-based set of the proposed law, as the reference of an objective."""
_LEAST = 0.05
"""Smallest RMSE of the oracle that counts, relative to the error of a successful run: far below, nothing is gained."""
_SMOOTH, _SMOOTH_EFFORT = 0.002, 0.2
"""Mean change of the effort from sample to sample that costs as much as the reference's RMSE: a share of the effort
limit, and at most N m or N, as in `pidtsm_core.experiment.gains`."""
_FREE_EFFORT = 1.004
"""ECI of a joint, relative to that of the reference, up to which effort costs nothing."""
_FAILED, _DIVERGED = 5.0, 100.0
"""Added if a run fails, and for one that diverges."""
_WORST = 10.0
"""Largest multiple of its limit that the error of a failed run counts as."""
_TRIED = 0.1
"""Weight of failing where the rule-based set fails too: little, or tracking suffers."""


@dataclass(frozen=True)
class Problem:
    """A controller's task under the conditions that it is judged in.

    Attributes:
        task: of the arm.
        conditions: simulator parameters by name.
        weights: one of `OBJECTIVES`.
        limits: effort limits, N m or N, shape (joints,).
        reference: RMSE and ECI of the rule-based set by condition, shape (2, joints) each.
        endured: conditions in which it is enough to succeed.
        beyond: conditions in which the rule-based set fails.
    """

    task: Task
    conditions: Mapping[str, Mapping[str, Any]]
    weights: Mapping[str, float]
    limits: Array
    reference: Mapping[str, Array]
    endured: Collection[str] = ()
    beyond: Collection[str] = ()


@dataclass(frozen=True)
class Result:
    """How a controller does under a condition.

    Attributes:
        cost: to be minimised; 1 and a little for the rule-based set.
        rmse: mean over the joints of the RMSE relative to that of the rule-based set; inf if the run diverged.
        variation: mean over the joints of the effort variation, relative to what is smooth.
        success: whether the run succeeded, see `pidtsm_studies.score`.
        metrics: rmse, eci, torque_variation and late_error, one value per joint; empty if the run diverged.
    """

    cost: float
    rmse: float
    variation: float
    success: bool
    metrics: Mapping[str, list[float]]


def make_problem(task: Task, kind: str, hardware: str, objective: str, reference: str = RULE) -> Problem:
    """The problem of tuning (``training``) or of its validation (``validation``).

    Args:
        task: of the arm.
        kind: see above.
        hardware: see `conditions`.
        objective: one of `OBJECTIVES`.
        reference: to what errors and effort are relative, `RULE` (the rule-based set of the proposed law) or `ORACLE`,
            which favours no law.

    Raises:
        UsageError: the reference diverges on this arm.
    """
    nominal = task.experiment(None, (PRACTICAL,))
    limits = effort_limits(nominal.values["simulator"])
    found = conditions(kind, hardware, task, limits)
    rule = nominal.settings["controller"]
    blank = Problem(task, found, OBJECTIVES[objective], limits, {})
    if blank.weights["margins"] and kind == "training":
        endured, beyond = _margins(blank, rule)
        blank = replace(blank, conditions=found | endured | beyond, endured={*endured}, beyond={*beyond})
    runs = _run(blank, [rule])[0] if reference == RULE else _of_oracle(blank)
    if any(run is None for run in runs):
        what = "the set of ./pidtsm gains" if reference == RULE else "the oracle"
        raise UsageError(f"{task.robot}: {what} diverges, so the objective has no reference")
    least = _LEAST * task.error if reference == ORACLE else 0.0
    found_reference = {
        name: np.array([np.maximum(run["rmse"], least), run["eci"]])
        for name, run in zip(blank.conditions, runs, strict=True)
        if run is not None
    }
    return replace(blank, reference=found_reference)


def _of_oracle(blank: Problem) -> list[Mapping[str, list[float]] | None]:
    """Metrics of the oracle by condition: of its speed with the smallest error that is not rough."""
    nominal = blank.task.experiment(None)
    settings = [
        {"scenario": _experiment(nominal, nominal.settings["controller"], simulator), "error": error}
        for error in ERRORS
        for simulator in blank.conditions.values()
    ]
    measure = partial(_measure, after=blank.task.after, limits=blank.limits)
    result = batch(settings, blank.task.duration, measure=measure, simulate=oracle)
    runs = metrics_of(result, len(settings))
    count = len(blank.conditions)

    def worst(run: Mapping[str, list[float]] | None) -> tuple[bool, float]:
        late, rough = _judged(blank.task, run)
        return rough > 1.0, late

    return [min(runs[i::count], key=worst) for i in range(count)]


def _margins(blank: Problem, rule: Mapping[str, Any]) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
    """For each of `MARGINS` and each seed, the last condition under which the rule-based set succeeds, and the next.

    A value that does not exist, or under which that set diverges, is left out.

    Returns:
        The conditions that this set endures, and those beyond.
    """
    endured: dict[str, dict[str, Any]] = {}
    beyond: dict[str, dict[str, Any]] = {}
    extent = Extent(MARGINS["values"], len(MARGINS["seeds"]))
    for criterion in (each for each in CRITERIA if each.name in MARGINS["criteria"]):
        (varied,) = criterion.ranges
        values = varied.values(extent)
        for seed in MARGINS["seeds"] if criterion.random else (0,):
            grid = {str(k): varied.settings(value, seed, blank.task, blank.limits) for k, value in enumerate(values)}
            runs = _run(replace(blank, conditions=grid), [rule])[0]
            last = len([*takewhile(lambda run: max(_judged(blank.task, run)) < 1.0, runs)]) - 1
            title = f"{criterion.label}, seed {seed}" if criterion.random else criterion.label
            for found, name, k in ((endured, title, last), (beyond, f"{title}, one step more", last + 1)):
                if 0 <= k < len(values) and runs[k] is not None:
                    found[name] = grid[str(k)]
    return endured, beyond


def evaluate(problem: Problem, controllers: Sequence[Mapping[str, Any]]) -> list[list[Result]]:
    """Simulate controllers under every condition, on all workers.

    Args:
        problem: of the arm.
        controllers: parameters of each.

    Returns:
        For each controller its results, in the order of the conditions.
    """
    return [
        [_result(problem, name, run) for name, run in zip(problem.conditions, runs, strict=True)]
        for runs in _run(problem, controllers)
    ]


def total(results: Sequence[Result]) -> float:
    """The objective: the mean of the costs."""
    return float(np.mean([each.cost for each in results]))


def _run(problem: Problem, controllers: Sequence[Mapping[str, Any]]) -> list[list[Mapping[str, list[float]] | None]]:
    """Metrics by controller and condition; None if the run diverged."""
    nominal = problem.task.experiment(None)
    settings = [
        {"scenario": _experiment(nominal, controller, simulator)}
        for controller in controllers
        for simulator in problem.conditions.values()
    ]
    measure = partial(_measure, after=problem.task.after, limits=problem.limits)
    result = batch(settings, problem.task.duration, measure=measure)
    runs = metrics_of(result, len(settings))
    count = len(problem.conditions)
    return [runs[i * count : (i + 1) * count] for i in range(len(controllers))]


def _experiment(nominal: Experiment, controller: Mapping[str, Any], simulator: Mapping[str, Any]) -> Experiment:
    settings = {
        **nominal.settings,
        "controller": dict(controller),
        "simulator": {**nominal.settings["simulator"], **simulator},
    }
    return replace(nominal, law=str(controller.get("law.name", LAW_NAME.default)), settings=settings)


def _measure(run: Recording, after: float, limits: Array) -> JointMetrics:
    """`judge`, and the change of the effort from sample to sample that 0.1 % exceed, as a share of its limit."""
    steps = np.abs(np.diff(run.effort, axis=0)) / limits
    return {**judge(run, after, limits), "fast_steps": np.quantile(steps, 0.999, axis=0).tolist()}


def _judged(task: Task, run: Mapping[str, list[float]] | None) -> tuple[float, float]:
    """Largest error and roughness, relative to what a successful run may have: both below 1 if the run succeeded."""
    if run is None:
        return np.inf, np.inf
    return max(run["late_error"]) / task.error, max(run["roughness"]) / ROUGHNESS


def _result(problem: Problem, condition: str, run: Mapping[str, list[float]] | None) -> Result:
    if run is None:
        return Result(_DIVERGED, np.inf, np.inf, False, {})
    values = {name: np.array(row) for name, row in run.items()}
    rmse, eci = problem.reference[condition]
    smooth = np.minimum(_SMOOTH * problem.limits, _SMOOTH_EFFORT)
    tracking = float(np.mean(values["rmse"] / rmse))
    variation = float(np.mean(values["torque_variation"] / smooth))
    effort = float(np.mean(np.maximum(values["eci"] / eci - _FREE_EFFORT, 0.0)))
    weights = problem.weights
    cost = (
        tracking
        + weights["variation"] * variation
        + weights["rate"] * float(values["fast_steps"].mean())
        + weights["limits"] * float(values["saturation"].mean())
        + weights["effort"] * effort
    )
    late, rough = _judged(problem.task, run)
    success = max(late, rough) < 1.0
    beyond = condition in problem.beyond
    if beyond or condition in problem.endured:
        cost = 1.0  # It is enough to succeed.
    if not success:
        cost += _TRIED * min(max(late, rough), _WORST) if beyond else _FAILED + min(late, _WORST)
    kept = ("rmse", "eci", "torque_variation", "late_error")
    return Result(cost, tracking, variation, success, {name: run[name] for name in kept})
