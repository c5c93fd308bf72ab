"""A tournament tunes and scores every cell, resumes, and gives the numbers of the commands that it consists of."""

import json
import shutil
from pathlib import Path

import pytest

from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.origin import commit, origin_of

ARGUMENTS = ["tournament", "--robot", "two_link", "--law", "computed_torque", "--hardware", "ideal", "--quick"]
BUDGET = ["--budget", "9"]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("tournament") / "out"
    assert main([*ARGUMENTS, *BUDGET, "--out", str(out)]) == 0
    return out


def test_a_cell_is_that_of_the_commands(out: Path, tmp_path: Path) -> None:
    score = out / "score" / "two_link" / "computed_torque" / "score.json"
    params = out / "tune" / "two_link" / "computed_torque" / "params.yaml"
    assert main(["score", "--quick", "--params", str(params), "--out", str(tmp_path / "again")]) == 0
    first, again = (json.loads(file.read_text()) for file in (score, tmp_path / "again" / "score.json"))
    assert first["criteria"] == again["criteria"]
    assert first["score"] == again["score"]
    cost = json.loads((params.parent / "tuning.json").read_text())["cost"]
    values = (cost[kind][when] for kind in ("training", "validation") for when in ("before", "after"))
    row = f"| two_link | computed_torque | {' | '.join(f'{value:.4g}' for value in values)} |"
    text = (out / "tournament.md").read_text()
    assert row in text.splitlines()
    made = "--robot two_link --law computed_torque --hardware ideal --objective balanced --budget 9 --seed 0"
    assert f"Made by `./pidtsm tournament {made}` on " in text
    assert "| computed torque |" in (out / "leaderboard.md").read_text()
    for folder in (out, score.parent, params.parent):
        origin = origin_of(folder)
        assert origin is not None
        assert (origin["commit"], origin["seed"]) == (commit(), 0)


def test_the_files_do_not_name_their_folder(out: Path) -> None:
    score = json.loads((out / "score" / "two_link" / "computed_torque" / "score.json").read_text())
    assert score["params"] == ["tune/two_link/computed_torque/params.yaml"]
    assert not [file for file in out.rglob("*.*") if str(out).encode() in file.read_bytes()]


def test_what_is_done_is_not_done_again(out: Path) -> None:
    files = [file for kind in ("tune", "score") for file in sorted((out / kind).rglob("*.*"))]
    before = {file: file.stat().st_mtime_ns for file in files}
    shutil.rmtree(out / "score" / "two_link")
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
