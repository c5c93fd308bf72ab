"""Runs of any kind are compared, and what cannot be compared is explained."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pidtsm_core.recording import Recording
from pidtsm_experiments.cli import main


def compare(capsys: pytest.CaptureFixture[str], *runs: Path | str) -> dict[str, Any]:
    assert main(["compare", *map(str, runs), "--json"]) == 0
    content: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert json.loads(Path("results/compare/comparison.json").read_text()) == content
    return content


def test_metrics_have_differences_and_parameters_differ(
    folder: Path, kept: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = compare(capsys, kept / "gentle", kept / "firm")
    assert content["parameters"] == {"controller.law.k1": {"gentle": 3.0, "firm": 4.0}}
    gentle, firm = (json.loads((kept / name / "metrics.json").read_text()) for name in ("gentle", "firm"))
    assert [run["metrics"] for run in content["runs"].values()] == [gentle, firm]
    assert list(content["differences"]) == ["firm"]
    for key in ("rmse", "eci", "torque_variation"):
        minus = [b - a for a, b in zip(gentle[key], firm[key], strict=True)]
        assert content["differences"]["firm"][key] == minus
    assert content["differences"]["firm"]["settling_time"] == [None, None]
    assert [path.name for path in (folder / "results").iterdir()] == ["compare"]


def test_the_terminal_shows_a_block_per_joint_in_eighty_columns(
    folder: Path, kept: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    names = ["gentle", "firm", "third", "fourth"]
    for name in names:
        shutil.copytree(kept / (name if name in ("gentle", "firm") else "firm"), name)
    assert main(["compare", *names, "--out", "mine"]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= 80
    heads = [line.split()[2:] for line in text.splitlines() if line.split()[:1] == ["metric"]]
    assert heads == [["gentle", "firm", "third"], ["gentle", "fourth"]] * 2
    firm, gentle = (json.loads((kept / name / "metrics.json").read_text())["rmse"][0] for name in ("firm", "gentle"))
    assert f"{gentle:.4g}" in text
    assert f"{firm:.4g} {100 * (firm / gentle - 1):+.1f} %" in text
    assert [line.split() for line in text.splitlines() if "law.k1" in line] == [
        ["controller.law.k1", "3.0", "4.0", "4.0", "4.0"]
    ]


def test_bags_and_folders_go_together(
    folder: Path, kept: Path, run: Recording, write_bag: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bag(folder / "run" / "bag", run)
    (folder / "other").mkdir()
    shutil.copytree(kept / "firm", "other/firm")
    content = compare(capsys, "run/bag", kept / "firm", "other/firm")
    assert list(content["runs"]) == ["run", str(kept / "firm"), "other/firm"], "paths where names are the same"
    assert [entry["metrics"]["samples"] for entry in content["runs"].values()] == [2000, 500, 500]
    assert content["parameters"] == {}, "those of the bag are not known"
    page = Path("results/compare/report.html").read_text(encoding="utf-8")
    assert "1 run of 2 s, 2000 samples, lockstep clock; 2 runs of 0.5 s, 500 samples, without ROS" in page


@pytest.mark.parametrize(
    ("words", "cause"),
    [
        (["gentle"], "compare needs at least two runs"),
        (["gentle", "firm", "gentle/../firm"], "firm is given twice"),
        (["gentle", "nowhere"], "nowhere: no such file or folder"),
        (["gentle", "."], ". is neither a result folder, which has bag/ or recording.npz, nor a bag"),
        (["gentle", "firm", "--out", "firm"], "--out firm is one of the runs"),
        (["gentle", "renamed"], "renamed has other joints than gentle: a (rad), b (rad) instead of joint1 (rad)"),
    ],
)
def test_what_cannot_be_compared_is_one_clear_error(
    folder: Path,
    kept: Path,
    run: Recording,
    write_bag: Any,
    words: list[str],
    cause: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("gentle", "firm"):
        (folder / name).symlink_to(kept / name)
    if "renamed" in words:

        def rename(_topic: str, _k: int, message: Any) -> Any:
            return replace(message, name=["a", "b"])

        write_bag(folder / "renamed" / "bag", run, rename)
    assert main(["compare", *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert cause in error
    assert not (folder / "results").exists()
