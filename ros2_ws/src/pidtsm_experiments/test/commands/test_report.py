"""A report is made anew from what was recorded."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from pidtsm_core.recording import Recording
from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.ownership import MARKER
from pidtsm_studies.reports import figures

MADE = ("metrics.json", "report.html", "figures/error.svg")


@pytest.fixture(autouse=True)
def few_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "FIGURES", {"error": figures.error})


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_rollout_is_reported_again_from_its_recording(folder: Path, kept: Path) -> None:
    shutil.copytree(kept / "firm", "mine")
    before = contents(folder / "mine")
    for name in MADE:
        (folder / "mine" / name).write_text("old")
    assert main(["report", "mine"]) == 0
    assert contents(folder / "mine") == before
    assert [path.name for path in folder.iterdir()] == ["mine"], "no litter"


def test_a_run_is_reported_again_from_its_bag(folder: Path, run: Recording, write_bag: Any) -> None:
    bag = write_bag(folder / "mine" / "bag", run)
    assert main(["report", "mine"]) == 0
    assert sorted({Path(name).parts[0] for name in contents(folder / "mine")} - {"bag", MARKER}) == [
        "figures",
        "metrics.json",
        "report.html",
        "run.json",
    ]
    assert bag.is_dir()


@pytest.mark.parametrize("damage", ["recording", "nothing", "absent"])
def test_without_a_recording_nothing_changes(
    folder: Path, kept: Path, damage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if damage != "absent":
        shutil.copytree(kept / "firm", "mine")
    if damage == "recording":
        (folder / "mine" / "recording.npz").write_bytes(b"PK not a file")
    elif damage == "nothing":
        (folder / "mine" / "recording.npz").unlink()
    before = contents(folder)
    assert main(["report", "mine"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("pidtsm: mine")
    assert ("not the recording of a rollout" if damage == "recording" else "neither bag/ nor recording.npz") in error
    assert contents(folder) == before
