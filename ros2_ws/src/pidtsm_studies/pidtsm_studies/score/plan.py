"""Which runs a score takes: the nominal ones, and one for each value of each range and each seed."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import PRACTICAL, Experiment
from pidtsm_studies.score.criteria import HARDWARE, Criterion, Extent, criteria_of
from pidtsm_studies.score.motions import Motion, motions
from pidtsm_studies.score.tasks import IDEAL, Task, effort_limits
from pidtsm_studies.score.variations import FASTEST, changes

_NOMINAL: Mapping[str, Mapping[str, Any]] = {"ideal": {}, "hardware": HARDWARE}
CONTROL = "bad gains"
"""Name of a controller that must fail: PID with a hundredth of the gains of the rule."""
_BAD = 0.01
_MOTIONS = 4
"""Number of the motions of the second edition."""


@dataclass(frozen=True)
class Contender:
    """A controller to be scored.

    Attributes:
        law: name of the law; None: that of the parameters, or the default.
        params: parameter sets, as for `make_experiment`.
        overrides: ``NODE.PARAMETER=VALUE``.
        name: name in tables.
        oracle: whether it is the oracle; law and parameters then do not matter.
    """

    law: str | None
    params: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    name: str = ""
    oracle: bool = False


def bad_gains(task: Task) -> Contender:
    """The control row: a score that it does not lose measures nothing."""
    rule = task.experiment("pid", (PRACTICAL,)).settings["controller"]
    weak = {name: (_BAD * np.asarray(rule[name])).tolist() for name in ("law.kp", "law.ki", "law.kd")}
    return Contender("pid", (PRACTICAL,), tuple(f"controller.{name}={each}" for name, each in weak.items()), CONTROL)


class Run(NamedTuple):
    """A run: the names of its criterion and its range, and the experiment."""

    key: tuple[str, str]
    experiment: Experiment


@dataclass(frozen=True)
class Plan:
    """The runs of a score.

    Attributes:
        experiment: the controller on the arm, without variation.
        limits: effort limits of the simulated arm, N m, shape (joints,).
        varied: in the order of criteria, ranges and values; seeds vary fastest.
        nominal: by name, see `Entry.nominal`.
    """

    experiment: Experiment
    limits: Array
    varied: tuple[Run, ...]
    nominal: Mapping[str, Run]


def make_plan(task: Task, contender: Contender, extent: Extent) -> Plan:
    """The runs of a score of a controller.

    Raises:
        UsageError: the controller or the arm is refused; see `Task.experiment`.
    """
    experiment = task.experiment(contender.law, contender.params, contender.overrides)
    limits = effort_limits(experiment.values["simulator"])
    make = _ideal_runs if task.base == IDEAL else _hardware_runs
    varied, nominal = make(task, experiment, limits, extent)
    last = {run.key: run for run in varied}
    for run in last.values():
        _ = run.experiment.values  # Refused: no failed run.
    return Plan(experiment, limits, varied, nominal)


def repeats_of(criterion: Criterion, extent: Extent, task: Task) -> int:
    """Number of runs for each value of a criterion."""
    if criterion.random:
        return extent.repeats
    return 1 if task.base == IDEAL else min(_MOTIONS, extent.repeats)


def _ideal_runs(
    task: Task, experiment: Experiment, limits: Array, extent: Extent
) -> tuple[tuple[Run, ...], dict[str, Run]]:
    def varied() -> Iterator[Run]:
        for criterion in criteria_of(task.base):
            for each in criterion.ranges:
                for value in each.values(extent):
                    for seed in range(repeats_of(criterion, extent, task)):
                        changed = each.settings(value, seed, task, limits)
                        yield Run((criterion.name, each.label), _with(experiment, changed))

    return tuple(varied()), {name: Run((name, ""), _with(experiment, each)) for name, each in _NOMINAL.items()}


def _hardware_runs(
    task: Task, experiment: Experiment, limits: Array, extent: Extent
) -> tuple[tuple[Run, ...], dict[str, Run]]:
    known, simulator = motions(experiment), experiment.values["simulator"]

    def varied() -> Iterator[Run]:
        for criterion in criteria_of(task.base):
            for each in criterion.ranges:
                for value in each.values(extent):
                    for seed in range(repeats_of(criterion, extent, task)):
                        motion: Motion = known[seed % len(known)]
                        motion = motion.at(value) if each.relative_to == FASTEST else motion
                        changed = changes(each, value, seed, task, limits, simulator)
                        yield Run((criterion.name, each.label), motion.of(_with(experiment, changed)))

    return tuple(varied()), {each.name: Run((each.name, ""), each.of(experiment)) for each in known}


def _with(experiment: Experiment, changed: Mapping[str, Any]) -> Experiment:
    simulator = {**experiment.settings["simulator"], **changed}
    return replace(experiment, settings={**experiment.settings, "simulator": simulator})
