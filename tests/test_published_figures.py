"""The figures of the tournament in the documentation are those of its data, and a cell of them is computed again."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pidtsm_core.robots import NAMES
from pidtsm_studies.score.criteria import Extent
from pidtsm_studies.score.leaderboard import document
from pidtsm_studies.score.measure import measure
from pidtsm_studies.score.plan import Contender
from pidtsm_studies.score.results import FILE, Entry, read_entry
from pidtsm_studies.score.tasks import ON_HARDWARE, find_task
from pidtsm_studies.tuning.objective import evaluate, make_problem, total

DOCS = Path(__file__).parents[1] / "docs"
DATA, SETS = DOCS / "tournament", DOCS / "sets"
CELL = Path("two_link", "computed_torque", "seed-0")
"""The cell that takes the least time."""
OLDER = ("controller.compensation.breakaway=false",)
"""What the tournament did not have yet."""
REFERENCES = ("oracle", "bad_gains")


def rules() -> dict[str, object]:
    found: dict[str, object] = json.loads((DATA / "tournament.json").read_text())["rules"]
    return found


def cost(cell: Path) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = json.loads((cell / "tuning.json").read_text())["cost"]
    return found


def searches(robot: Path) -> Iterator[list[Path]]:
    """The folders of a law's searches on an arm, the one with the best objective in training first."""
    for law in sorted(DATA.glob(f"tune/{robot.name}/*")):
        yield sorted(law.glob("seed-*"), key=lambda cell: cost(cell)["training"]["after"])


def rows() -> list[Entry]:
    """The rows of the leaderboard: the best search of every law on every arm, and the references."""
    found = []
    for robot in sorted(DATA.glob("score/*")):
        best = [DATA / "score" / cells[0].relative_to(DATA / "tune") for cells in searches(robot)]
        found += [read_entry(each / FILE) for each in (*best, *(robot / name for name in REFERENCES))]
    return found


def test_a_cell_has_the_score_that_is_published() -> None:
    """Both ends of every range, with every seed."""
    published, params = read_entry(DATA / "score" / CELL / FILE), str(DATA / "tune" / CELL / "params.yaml")
    contender = Contender(CELL.parts[1], (params,), OLDER, CELL.parts[1])
    again = measure(find_task(CELL.parts[0], None, ON_HARDWARE), contender, Extent(2, published.extent.repeats))
    assert again.controller == {**published.controller, "compensation.breakaway": False}
    for old, new in zip(published.outcomes, again.outcomes, strict=True):
        for of_all, of_some in zip(old.curves, new.curves, strict=True):
            assert of_some.values == (of_all.values[0], of_all.values[-1])
            assert of_some.successes == (of_all.successes[0], of_all.successes[-1])
    for run, metrics in published.nominal.items():
        found = again.nominal[run]
        assert metrics is not None
        assert found is not None
        for name, values in metrics.items():
            np.testing.assert_allclose(found[name], values, rtol=1e-9)


def test_a_cell_has_the_objective_that_is_published() -> None:
    task, made = find_task(CELL.parts[0], None, ON_HARDWARE), rules()
    params = str(DATA / "tune" / CELL / "params.yaml")
    controller = task.experiment(CELL.parts[1], (params,), OLDER).settings["controller"]
    for kind in ("training", "validation"):
        problem = make_problem(task, kind, str(task.hardware), str(made["objective"]), str(made["reference"]))
        (results,) = evaluate(problem, [controller])
        assert total(results) == pytest.approx(cost(DATA / "tune" / CELL)[kind]["after"], rel=1e-9)


def test_nobody_is_better_than_the_oracle_and_bad_gains_are_bad() -> None:
    """In no criterion, within its interval; for all searches, not only the best of a law."""
    for robot in sorted(DATA.glob("score/*")):
        oracle, bad = (read_entry(robot / name / FILE) for name in REFERENCES)
        assert bad.score < 0.1
        for file in sorted(robot.glob(f"*/seed-*/{FILE}")):
            for ceiling, outcome in zip(oracle.outcomes, read_entry(file).outcomes, strict=True):
                assert outcome.share <= ceiling.interval[1], f"{file}: {outcome.criterion.name}"


@pytest.mark.parametrize("robot", NAMES)
def test_the_tuned_set_of_every_arm_has_a_higher_score_than_the_rule(robot: str) -> None:
    """On ideal hardware, in the first edition of the score."""
    rule, tuned = (read_entry(SETS / robot / f"{name}.json") for name in ("rule", "tuned"))
    for entry, params in ((rule, "practical"), (tuned, "tuned_14bit")):
        controller = find_task(robot).experiment("piddtsm", (params,)).settings["controller"]
        assert entry.controller == json.loads(json.dumps(dict(controller))), "the set has changed: score it again"
    assert tuned.score > rule.score


def test_the_tables_are_those_of_the_data() -> None:
    assert (DOCS / "leaderboard.md").read_text() == document(rows())


def test_every_law_has_as_many_searches() -> None:
    counts = {len(cells) for robot in DATA.glob("score/*") for cells in searches(robot)}
    assert counts == {rules()["seeds"]}
