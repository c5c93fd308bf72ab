"""The ranges of the score vary what they promise."""

from typing import Any

import numpy as np
import pytest

from pidtsm_core.experiment import PRACTICAL
from pidtsm_core.parameters import ParameterError
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies.score.criteria import CRITERIA, FULL, Criterion, Range
from pidtsm_studies.score.tasks import Task

EACH = pytest.mark.parametrize(
    ("criterion", "each"),
    [pytest.param(c, r, id=f"{c.name} {r.label}") for c in CRITERIA for r in c.ranges],
)
LIMITS = np.array([100.0, 50.0])


def test_the_criteria_are_those_of_the_issue() -> None:
    """Those of DFKI's double_pendulum, then what tracking on real hardware adds."""
    assert [each.name for each in CRITERIA] == [
        "model",
        "noise",
        "torque_noise",
        "responsiveness",
        "delay",
        "pushes",
        "payload",
        "loss",
        "encoder",
        "friction",
    ]
    assert (FULL.values, FULL.repeats) == (21, 10)


@EACH
def test_a_range_has_21_different_values_and_changes_the_run_at_its_end(
    criterion: Criterion, each: Range, task: Task
) -> None:
    values = each.values(FULL)
    assert len(set(values)) == 21
    assert (values[0], values[-1]) == (each.first, each.last)
    first, again, other = (run(task, each.settings(values[-1], seed, task, LIMITS)) for seed in (0, 0, 1))
    assert first == again
    assert (first != other) == criterion.random
    assert first != run(task, {})


def run(task: Task, changes: dict[str, Any]) -> bytes:
    nominal = task.experiment(None, (PRACTICAL,))
    try:
        return rollout(nominal, duration=4.2, simulator=changes).effort.tobytes()
    except ParameterError as error:
        pytest.fail(str(error))


def test_a_push_acts_on_one_joint_within_a_second_of_the_event(task: Task) -> None:
    (pushes,) = (each.ranges[0] for each in CRITERIA if each.name == "pushes")
    drawn = [pushes.settings(0.5, seed, task, LIMITS) for seed in range(20)]
    efforts = {tuple(each["push.effort"]) for each in drawn}
    assert efforts == {(50.0, 0.0), (-50.0, 0.0), (0.0, 25.0), (0.0, -25.0)}
    assert all(task.event <= each["push.time"] < task.event + 1.0 for each in drawn)
