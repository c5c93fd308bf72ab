"""A tournament tunes and scores every cell, resumes, and gives the numbers of the commands that it consists of."""

import json
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
import yaml

from pidtsm_core.recording.provenance import commit
from pidtsm_experiments.cli import main
from pidtsm_experiments.commands.tournament_time import rollouts
from pidtsm_experiments.runs.origin import origin_of
from pidtsm_studies.reports import figures
from pidtsm_studies.score import criteria, leaderboard, tasks
from pidtsm_studies.score.criteria import extent_of
from pidtsm_studies.score.tasks import ON_HARDWARE, find_task
from pidtsm_studies.tuning.search import Budget

ARGUMENTS = ["tournament", "--robot", "two_link", "--law", "computed_torque", "--seeds", "2", "--quick"]
BUDGET = ["--budget", "5"]


def _save_empty_figures(drawn: Iterable[str], folder: Path) -> list[Path]:
    return figures.save_figures(dict.fromkeys(drawn, lambda: figures.panels(1)[0]), folder)


@pytest.fixture(scope="module", autouse=True)
def _short_runs_few_values_and_empty_figures(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Quicker than `--quick`; test_leaderboard.py of pidtsm_studies draws the figures."""
    shorter = tmp_path_factory.mktemp("tasks") / "arms.yaml"
    rows = yaml.safe_load(tasks._FILE.read_text("utf-8"))
    for row in rows.values():
        row |= {"duration": 5.0, "event": 2.0, "after": 4.0}
    shorter.write_text(yaml.safe_dump(rows), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tasks, "_FILE", shorter)
        patch.setattr(criteria, "QUICK_ON_HARDWARE", criteria.Extent(values=2, repeats=1))
        patch.setattr(leaderboard, "save_figures", _save_empty_figures)
        yield


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("tournament") / "out"
    assert main([*ARGUMENTS, *BUDGET, "--out", str(out)]) == 0
    return out


def cell(out: Path, kind: str, seed: int) -> Path:
    return out / kind / "two_link" / "computed_torque" / f"seed-{seed}"


def test_a_cell_is_that_of_the_commands(out: Path, tmp_path: Path) -> None:
    params = cell(out, "tune", 1) / "params.yaml"
    again = ["--params", str(params), "--out", str(tmp_path / "again")]
    assert main(["score", "--quick", "--base", "hardware", *again]) == 0
    first, second = (
        json.loads((folder / "score.json").read_text()) for folder in (cell(out, "score", 1), tmp_path / "again")
    )
    assert first["criteria"] == second["criteria"]
    tune = ["--law", "computed_torque", "--hardware", "direct_drive", "--reference", "oracle", "--seed", "1"]
    assert main(["tune", *tune, *BUDGET, "--out", str(tmp_path / "tuned")]) == 0
    assert (tmp_path / "tuned" / "history.jsonl").read_text().splitlines()[0] == (
        cell(out, "tune", 1) / "history.jsonl"
    ).read_text().splitlines()[0]
    costs = [json.loads((cell(out, "tune", seed) / "tuning.json").read_text()) for seed in range(2)]
    assert json.loads((tmp_path / "tuned" / "tuning.json").read_text())["cost"] == costs[1]["cost"]
    assert [each["evaluations"] for each in costs] == [5, 5]
    after = [each["cost"]["training"]["after"] for each in costs]
    assert (
        f"| two_link | computed_torque | {costs[0]['cost']['training']['before']:.4g} | {min(after):.4g} | "
        in (out / "tournament.md").read_text()
    )


def test_the_leaderboard_has_the_best_search_and_both_references(out: Path) -> None:
    text = (out / "leaderboard.md").read_text()
    rows = [line.split(" | ")[0] for line in text.splitlines() if line.startswith("| ")]
    assert rows == ["| controller", "| ---", "| oracle", "| computed torque", "| bad gains"]
    made = "--robot two_link --law computed_torque --hardware own --objective balanced --budget 5 --seeds 2"
    assert f"Made by `./pidtsm tournament {made}` on " in (out / "tournament.md").read_text()
    for folder in (out, cell(out, "score", 0), cell(out, "tune", 0)):
        origin = origin_of(folder)
        assert origin is not None
        assert (origin["commit"], origin["seed"]) == (commit(), 0)


def test_the_files_do_not_name_their_folder(out: Path) -> None:
    score = json.loads((cell(out, "score", 0) / "score.json").read_text())
    assert score["params"] == ["tune/two_link/computed_torque/seed-0/params.yaml"]
    assert not [file for file in out.rglob("*.*") if str(out).encode() in file.read_bytes()]


def test_what_is_done_is_not_done_again(out: Path) -> None:
    files = [file for kind in ("tune", "score") for file in sorted((out / kind).rglob("*.*"))]
    before = {file: file.stat().st_mtime_ns for file in files}
    shutil.rmtree(cell(out, "score", 0))
    (out / "leaderboard.md").unlink()
    rules = out / "tournament.json"
    content = json.loads(rules.read_text())
    content["made"][0]["date"] = "2026-01-02"
    rules.write_text(json.dumps(content))
    for _ in range(2):
        assert main([*ARGUMENTS, *BUDGET, "--out", str(out)]) == 0
    assert (out / "leaderboard.md").exists()
    assert (out / "tournament.md").read_text().count(f", commit {content['made'][0]['commit'][:12]}") == 2
    assert json.loads(rules.read_text())["made"][:-1] == content["made"]
    tuned = {file: time for file, time in before.items() if "tune" in file.parts}
    assert tuned == {file: file.stat().st_mtime_ns for file in tuned}


def test_other_rules_are_refused(out: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main([*ARGUMENTS, "--budget", "10", "--out", str(out)]) == 2
    assert "has a tournament with other rules" in capfd.readouterr().err
    (tmp_path / "thesis.tex").write_text("years of work")
    assert main([*ARGUMENTS, *BUDGET, "--out", str(tmp_path)]) == 2
    assert "contains other files; choose another --out" in capfd.readouterr().err


def test_the_estimate_counts_the_rollouts_that_are_made(out: Path) -> None:
    task = find_task("two_link", None, ON_HARDWARE)
    extent = extent_of(task.base, quick=True)
    trained, scored = rollouts("computed_torque", "direct_drive", task, Budget(evaluations=5), extent)
    assert json.loads((cell(out, "score", 0) / "score.json").read_text())["runs"] == scored + 4
    tuning = json.loads((cell(out, "tune", 0) / "tuning.json").read_text())
    assert trained == (tuning["evaluations"] + 2 * len(tuning["sensitivity"])) * len(tuning["training"])
