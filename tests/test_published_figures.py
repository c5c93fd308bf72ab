"""The figures of the tournament in the documentation are those of its data, and a cell of them is computed again."""

import json
from pathlib import Path

import numpy as np
import pytest

from pidtsm_core.robots import NAMES
from pidtsm_studies.score.criteria import FULL, Extent
from pidtsm_studies.score.leaderboard import document, read_entries
from pidtsm_studies.score.measure import measure
from pidtsm_studies.score.plan import Contender
from pidtsm_studies.score.results import FILE, read_entry
from pidtsm_studies.score.tasks import find_task
from pidtsm_studies.tuning.objective import evaluate, make_problem, total

DOCS = Path(__file__).parents[1] / "docs"
DATA = DOCS / "tournament"
ROBOT, LAW = "scara", "computed_torque"
"""The cell that takes the least time."""
FEWER = Extent(values=3, repeats=FULL.repeats)
"""Both ends and the middle of every range."""


@pytest.fixture(scope="module")
def params() -> str:
    return str(DATA / "tune" / ROBOT / LAW / "params.yaml")


def test_a_cell_has_the_score_that_is_published(params: str) -> None:
    published = read_entry(DATA / "score" / ROBOT / LAW / FILE)
    again = measure(find_task(ROBOT), Contender(LAW, (params,), name=LAW), FEWER)
    assert again.controller == published.controller
    for old, new in zip(published.outcomes, again.outcomes, strict=True):
        for of_all, of_some in zip(old.curves, new.curves, strict=True):
            assert of_some.values == of_all.values[:: (FULL.values - 1) // 2]
            assert of_some.successes == of_all.successes[:: (FULL.values - 1) // 2]
    for run, metrics in published.nominal.items():
        found = again.nominal[run]
        assert metrics is not None
        assert found is not None
        for name, values in metrics.items():
            np.testing.assert_allclose(found[name], values, rtol=1e-9)


def test_a_cell_has_the_objective_that_is_published(params: str) -> None:
    published = json.loads((DATA / "tune" / ROBOT / LAW / "tuning.json").read_text())["cost"]
    rules = json.loads((DATA / "tournament.json").read_text())["rules"]
    task = find_task(ROBOT)
    controller = task.experiment(LAW, (params,)).settings["controller"]
    for kind in ("training", "validation"):
        problem = make_problem(task, kind, rules["hardware"], rules["objective"])
        (results,) = evaluate(problem, [controller])
        assert total(results) == pytest.approx(published[kind]["after"], rel=1e-9)


@pytest.mark.parametrize("robot", NAMES)
def test_the_tuned_set_of_every_arm_has_a_higher_score_than_the_rule(robot: str) -> None:
    rule, tuned = (read_entry(DATA / "score" / robot / name / FILE) for name in ("rule", "tuned"))
    for entry, params in ((rule, "practical"), (tuned, "tuned_14bit")):
        controller = find_task(robot).experiment("piddtsm", (params,)).settings["controller"]
        assert entry.controller == json.loads(json.dumps(dict(controller))), "the set has changed: score it again"
    assert tuned.score > rule.score


def test_the_tables_are_those_of_the_data() -> None:
    assert (DOCS / "leaderboard.md").read_text() == document(read_entries(DATA / "score"))
