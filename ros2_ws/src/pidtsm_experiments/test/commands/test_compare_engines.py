"""``./pidtsm compare-engines``: table, figure and JSON."""

import json
from pathlib import Path

import pytest

from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.origin import origin_of

WORDS = ["compare-engines", "--robot", "scara", "--duration", "0.2"]


def test_it_leaves_a_figure_and_the_numbers(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*WORDS, "--out", "engines"]) == 0
    table = capsys.readouterr().out
    content = json.loads((folder / "engines" / "engines.json").read_text(encoding="utf-8"))
    for joint, difference in zip(content["joints"], content["largest_difference"], strict=True):
        assert f"{difference:.1e}" in next(line for line in table.splitlines() if joint in line)
    assert max(map(len, table.splitlines())) <= 80
    page = (folder / "engines" / "report.html").read_text(encoding="utf-8")
    assert "the equations of the model and MuJoCo" in page
    assert {file.name for file in (folder / "engines" / "figures").iterdir()} == {"engines.png", "engines.svg"}
    origin = origin_of(folder / "engines")
    assert origin is not None
    assert origin["parameters"]["simulator"]["robot.description"] == "scara"
    assert main([*WORDS, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == content


def test_a_robot_that_does_not_exist_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare-engines", "--robot", "skara"]) == 2
    assert "did you mean scara?" in capsys.readouterr().err
    assert not (folder / "results" / "engines").exists()
