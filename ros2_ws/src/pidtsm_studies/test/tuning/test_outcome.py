"""What a tuning has found is judged on conditions that it has not seen, and shown."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from support.devtools import CHROMIUM, Page

from pidtsm_core.parameters.files import load_ros_parameters
from pidtsm_studies.limit.known import above_limit
from pidtsm_studies.score.tasks import Task
from pidtsm_studies.tuning.objective import Problem, evaluate, make_problem, total
from pidtsm_studies.tuning.outcome import SHIFT, Tuning, as_json, conclude, parameter_file
from pidtsm_studies.tuning.report import front, nominal_runs, write_tuning_page
from pidtsm_studies.tuning.search import Budget, search
from pidtsm_studies.tuning.space import Space


@pytest.fixture(scope="module")
def tuning(
    space: Space, problem: Problem, task: Task, identity: dict[str, object], tmp_path_factory: pytest.TempPathFactory
) -> Tuning:
    history = tmp_path_factory.mktemp("outcome") / "history.jsonl"
    generations = search(space, problem, identity, history, Budget(evaluations=20))
    return conclude(identity, space, generations, problem, make_problem(task, "validation", "14bit", "balanced"))


@pytest.fixture(scope="module")
def page_file(tuning: Tuning, problem: Problem, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "tuning.html"
    write_tuning_page(path, tuning, nominal_runs(tuning, problem))
    return path


def test_the_arm_on_the_page_moves_as_in_the_nominal_condition(tuning: Tuning, problem: Problem) -> None:
    runs = nominal_runs(tuning, problem)
    judged = dict(zip(("before", "after"), tuning.training["nominal"], strict=True))
    assert {name: metrics["rmse"] for name, (_, metrics) in runs.items()} == {
        name: result.metrics["rmse"] for name, result in judged.items()
    }


def test_the_parameter_file_gives_the_objective_that_is_stated(
    tuning: Tuning, problem: Problem, tmp_path: Path
) -> None:
    file = tmp_path / "params.yaml"
    file.write_text(parameter_file(tuning, "./pidtsm tune --seed 3"))
    assert file.read_text().startswith("# ./pidtsm tune --seed 3\n")
    nominal = problem.task.experiment("piddtsm", (str(file),))
    assert load_ros_parameters(file)["controller"].keys() == tuning.parameters.keys()
    (results,) = evaluate(problem, [nominal.settings["controller"]])
    assert total(results) == tuning.objective("training")[1] == min(min(each.costs) for each in tuning.generations)


def test_sensitivity_is_that_of_one_gain(tuning: Tuning, problem: Problem) -> None:
    place = [each.label for each in tuning.space.variables].index("law.k1, joint 1")
    k1 = tuning.parameters["law.k1"]
    for row, factor in enumerate((1.0 / SHIFT, SHIFT)):
        x = tuning.x.copy()
        variable = tuning.space.variables[place]
        x[place] = variable.place(variable.value_at(x[place]) * factor)
        changed = tuning.space.controller(x)
        assert changed["law.k1"] == [pytest.approx(k1[0] * factor, rel=1e-3), k1[1]]
        (results,) = evaluate(problem, [changed])
        assert tuning.sensitivity[row, place] == total(results) - tuning.objective("training")[1]


def test_the_json_has_training_and_validation_side_by_side(tuning: Tuning) -> None:
    content = json.loads(json.dumps(as_json(tuning), allow_nan=False))
    assert set(content["training"]) == set(tuning.training) != set(content["validation"])
    assert content["objective"] == tuning.identity["objective"]
    assert content["cost"]["validation"]["after"] == tuning.objective("validation")[1]


def test_the_front_has_what_nothing_beats_in_both() -> None:
    rmse, variation = np.array([3.0, 1.0, 2.0, 2.0, 1.0]), np.array([1.0, 4.0, 2.0, 3.0, 5.0])
    assert front(rmse, variation).tolist() == [0, 2, 1]


def test_the_page_states_what_was_tuned(page_file: Path, tuning: Tuning) -> None:
    text = page_file.read_text(encoding="utf-8")
    assert re.findall(r'<h2 id="(\w+)"', text) == ["motion", "result", "search", "gains"]
    for name in (*tuning.training, *tuning.validation, *(each.label for each in tuning.space.variables)):
        assert f'<th scope="row">{name}</th>' in text
    above = above_limit("two_link", tuning.training["nominal"][1].metrics["rmse"])
    assert f"any controller can reach (<code>./pidtsm limit</code>) by {above}." in text
    assert "default-src 'none'" in text


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium installed (apt-get install chromium)")
def test_a_browser_draws_it(page: Page, page_file: Path) -> None:
    page.open(page_file)
    for plot in ("progress", "front"):
        assert page.evaluate(f"document.getElementById('{plot}').plot.series.length") > 2
    assert page.evaluate("document.querySelectorAll('#arm .links').length") == 2, "before and after"
    assert page.complaints == []
