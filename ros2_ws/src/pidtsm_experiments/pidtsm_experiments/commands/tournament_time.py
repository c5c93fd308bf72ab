"""How long a tournament takes, from the time of a few of its rollouts."""

import os
import time
from collections.abc import Sequence

from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.commands.options import CONSOLE
from pidtsm_studies.score.criteria import Extent, criteria_of
from pidtsm_studies.score.plan import repeats_of
from pidtsm_studies.score.tasks import Task, effort_limits
from pidtsm_studies.tuning.definitions import conditions
from pidtsm_studies.tuning.search import Budget
from pidtsm_studies.tuning.space import make_space

_SHORT = 0.1
"""Duration of a rollout after which everything is compiled, s."""


def say_time(searches: Sequence[tuple[ArmDefinition, str, str, Task]], limit: Budget, extent: Extent) -> None:
    """Print how long the searches that are left, and their scores, take on this machine.

    Args:
        searches: arm, law, hardware and task of each.
        limit: of each search.
        extent: of each score.
    """
    seconds: dict[str, float] = {}
    total = 0.0
    for arm, law, hardware, task in searches:
        if arm.label not in seconds:
            seconds[arm.label] = _seconds(task)
        trained, scored = rollouts(law, hardware, task, limit, extent)
        total += seconds[arm.label] * (trained + scored) / (os.cpu_count() or 1)
        total += 0.0 if limit.evaluations else limit.seconds
    hours, minutes = divmod(round(total / 60.0), 60)
    CONSOLE.print(
        f"about {hours} h {minutes} min for {len(searches)} searches and their scores, on {os.cpu_count()} free cores; "
        "the same command resumes",
        highlight=False,
    )


def rollouts(law: str, hardware: str, task: Task, limit: Budget, extent: Extent) -> tuple[int, int]:
    """Number of rollouts of a search (with its sensitivities), and of its score."""
    limits = effort_limits(task.experiment(law).values["simulator"])
    each = len(conditions("training", hardware, task, limits))
    candidates = limit.evaluations + 2 * len(make_space(task, law).variables)
    criteria = criteria_of(task.base)
    runs = sum(len(c.ranges) * extent.values * repeats_of(c, extent, task) for c in criteria)
    return candidates * each, runs


def _seconds(task: Task) -> float:
    """Processor time of a rollout of a task, s."""
    experiment = task.experiment(None)
    rollout(experiment, duration=_SHORT)
    begin = time.process_time()
    rollout(experiment, duration=task.duration)
    return time.process_time() - begin
