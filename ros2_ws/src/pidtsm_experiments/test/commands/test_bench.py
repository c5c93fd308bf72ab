"""The benchmark command: fields of the rows, and checked names. The measured values are not judged here."""

import json
import signal
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest

from pidtsm_experiments.cli import main
from pidtsm_experiments.commands.bench import Row, medians
from pidtsm_experiments.commands.bench_against import show
from pidtsm_experiments.runs.origin import making, origin_of

FIELDS = {"benchmark", "met", *(field.name for field in fields(Row))}
OWN = ["analyze", "batch", "dask_workers", "dynamics", "library", "rollout", "tick"]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Results are written below the working folder."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", OWN)
def test_a_quick_run_yields_rows(tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str) -> None:
    assert main(["bench", "--quick", "--json", "--out", str(tmp_path), "--only", name]) == 0
    result = json.loads(capfd.readouterr().out)
    assert json.loads((tmp_path / "bench.json").read_text()) == result
    assert result["rows"]
    assert result.items() >= making().items()
    assert origin_of(tmp_path) is not None
    for row in result["rows"]:
        assert set(row) == FIELDS
        assert row["benchmark"] == name
        assert row["figure"] > 0.0
        assert (row["floor"] is None) == (row["floor_figure"] is None) == (row["ratio"] is None)
        assert row["target"] is None or row["ratio"] is not None
        assert row["met"] is None


def test_the_rows_name_figure_floor_and_target(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--quick", "--only", "batch"]) == 0
    out = capfd.readouterr().out
    assert "one core" in out
    assert "ratio" in out
    assert max(map(len, out.splitlines())) <= 80


def test_a_benchmark_that_compiles_runs_again_in_the_next_process_and_keeps_its_rows_if_that_is_interrupted(
    tmp_path: Path,
) -> None:
    command = [sys.executable, "-m", "pidtsm_experiments.cli", "bench", "--quick", "--only", "tick"]
    subprocess.run([*command, "--json"], check=True, capture_output=True)
    with subprocess.Popen([*command, "soak"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        shown = []
        for line in process.stdout:
            shown.append(line)
            if line == "soak\n":
                process.send_signal(signal.SIGINT)
        assert process.wait() == 130
    kept = json.loads((tmp_path / "results" / "bench" / "bench.json").read_text())
    assert not kept["complete"]
    assert {row["benchmark"] for row in kept["rows"]} == {"tick"}
    for row in kept["rows"]:
        assert any(row["name"] in line for line in shown)


def test_without_a_name_only_lists_the_benchmarks(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--only"]) == 0
    lines = capfd.readouterr().out.splitlines()
    assert set(OWN) < {line.split(":")[0] for line in lines}
    assert all("about" in line and line.endswith("min") for line in lines)


def test_figures_of_two_commits_are_set_against_each_other(capfd: pytest.CaptureFixture[str]) -> None:
    old, new = {("tick", "a"): [4.0, 2.0, 3.0], ("tick", "gone"): [1.0]}, {("tick", "a"): [1.0, 1.5, 2.0]}
    show("abc", old, new, as_json=True)
    result = json.loads(capfd.readouterr().out)
    assert result["rows"] == [{"benchmark": "tick", "name": "a", "before": 3.0, "now": 1.5, "ratio": 0.5}]
    show("abc", old, new, as_json=False)
    assert "3 -> 1.5; ratio 0.500" in capfd.readouterr().out


def test_a_commit_that_does_not_exist_is_refused(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--only", "tick", "--against", "nowhere"]) == 2
    assert "nowhere" in capfd.readouterr().err


def test_an_unknown_benchmark_is_rejected_with_a_list_of_the_known_ones(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--only", "rolout"]) == 2
    error = capfd.readouterr().err
    assert "rolout" in error
    assert all(name in error for name in OWN)


@pytest.mark.parametrize(
    ("ratio", "target", "met"),
    [(1.9, "<= 2", True), (2.1, "<= 2", False), (99.0, ">= 100", False), (100.0, ">= 100", True), (3.0, None, None)],
)
def test_a_target_is_met_or_not(ratio: float, target: str | None, met: bool | None) -> None:
    assert Row("x", 1.0, "s", "floor", 1.0, ratio, target).met is met


def test_functions_that_are_compared_take_turns_after_a_warm_up() -> None:
    calls: list[str] = []
    times = medians(2, lambda: calls.append("a"), lambda: calls.append("b"))
    assert calls == ["a", "b"] * 3
    assert len(times) == 2
