"""A search that is interrupted anywhere and resumed gives the same result as one that is not."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pidtsm_core.errors import UsageError
from pidtsm_studies.tuning import search as module
from pidtsm_studies.tuning.objective import Problem, Result, evaluate
from pidtsm_studies.tuning.search import Budget, Generation, best, search
from pidtsm_studies.tuning.space import Space

BUDGET = Budget(evaluations=30)


@pytest.fixture(scope="module")
def history(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("search") / "history.jsonl"


@pytest.fixture(scope="module")
def whole(space: Space, problem: Problem, identity: dict[str, object], history: Path) -> list[Generation]:
    return search(space, problem, identity, history, BUDGET)


def test_it_ends_after_the_generation_that_spends_the_budget(whole: list[Generation]) -> None:
    sizes = [len(each.costs) for each in whole]
    assert sum(sizes[:-1]) < 30 <= sum(sizes)
    assert BUDGET.share(whole) >= 1.0


def test_candidates_are_within_their_bounds_and_the_best_is_better_than_the_worst(whole: list[Generation]) -> None:
    x, cost = best(whole)
    assert all(((each.x >= 0.0) & (each.x <= 1.0)).all() for each in whole)
    assert cost == min(min(each.costs) for each in whole) < max(max(each.costs) for each in whole)
    assert any((x == row).all() for each in whole for row in each.x)


def test_the_start_is_the_first_candidate(whole: list[Generation], space: Space) -> None:
    np.testing.assert_allclose(whole[0].x[0], space.start, atol=0.02)  # CMA-ES keeps off the bounds.


@pytest.mark.parametrize("kept", np.random.default_rng(1).uniform(0.0, 1.0, 10).round(3).tolist())
def test_a_search_killed_at_any_moment_is_resumed(
    kept: float,
    whole: list[Generation],
    history: Path,
    tmp_path: Path,
    space: Space,
    problem: Problem,
    identity: dict[str, object],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    content = history.read_bytes()
    broken = tmp_path / "history.jsonl"
    broken.write_bytes(content[: int(kept * len(content))])
    known = broken.read_bytes().count(b"\n") - 1
    simulated: list[int] = []

    def counted(problem: Problem, controllers: Sequence[Mapping[str, Any]]) -> list[list[Result]]:
        simulated.append(len(controllers))
        return evaluate(problem, controllers)

    monkeypatch.setattr(module, "evaluate", counted)
    again = search(space, problem, identity, broken, BUDGET)
    assert len(simulated) == len(whole) - max(known, 0)
    for one, other in zip(again, whole, strict=True):
        assert one.x.tobytes() == other.x.tobytes()
        assert (one.costs, one.rmse, one.variation) == (other.costs, other.rmse, other.variation)


def test_the_history_of_another_search_is_refused(
    whole: list[Generation], history: Path, space: Space, problem: Problem, identity: dict[str, object]
) -> None:
    assert whole
    with pytest.raises(UsageError, match=r"is of another search: .* choose another --out, or delete the file"):
        search(space, problem, {**identity, "seed": 4}, history, BUDGET)


def test_a_budget_of_time_counts_what_the_history_took(whole: list[Generation], history: Path) -> None:
    seconds = [json.loads(line)["seconds"] for line in history.read_text().splitlines()[1:]]
    assert Budget(seconds=2.0 * sum(seconds)).share(whole) == pytest.approx(0.5)
    assert Budget(evaluations=10_000, seconds=sum(seconds)).share(whole) == pytest.approx(1.0)
