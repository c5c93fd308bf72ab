"""The robustness command writes and prints the results of the study, and ends cleanly when interrupted."""

import json
import math
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pidtsm_experiments.cli import main
from pidtsm_studies.robustness.imperfections import IMPERFECTIONS
from pidtsm_studies.robustness.requirements import REQUIREMENTS
from pidtsm_studies.robustness.results import QUICK, Robustness, as_json
from pidtsm_studies.robustness.study import measure

DEADLINE = 120.0


@pytest.fixture(scope="module")
def quick() -> Robustness:
    return measure(QUICK)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("robustness") / "out"


@pytest.fixture(scope="module")
def printed(out: Path) -> dict[str, Any]:
    command = [sys.executable, "-m", "pidtsm_experiments.cli", "robustness", "--quick", "--json", "--out", str(out)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def test_all_results_are_written(out: Path, printed: dict[str, Any]) -> None:
    assert json.loads((out / "robustness.json").read_text()) == printed
    figures = {f"{imperfection.name}.{kind}" for imperfection in IMPERFECTIONS for kind in ("png", "svg")}
    assert {file.name for file in (out / "figures").iterdir()} == figures
    assert {entry.name for entry in out.iterdir()} == {"robustness.json", "figures", "report.html"}


def test_its_numbers_are_those_of_the_study(printed: dict[str, Any], quick: Robustness) -> None:
    assert printed == json.loads(json.dumps(as_json(quick)))


def test_the_tables_on_the_terminal_name_all(
    quick: Robustness, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    lost = [
        {name: replace(each, values=dict.fromkeys(each.values, math.inf)) for name, each in by_contender.items()}
        for by_contender in quick.achievements
    ]
    command = "pidtsm_experiments.commands.robustness"
    monkeypatch.setattr(f"{command}.measure", lambda *_: replace(quick, achievements=lost))
    for name in ("write_robustness_figures", "write_robustness_report"):
        monkeypatch.setattr(f"{command}.{name}", lambda *_: None)
    assert main(["robustness", "--out", str(tmp_path / "out")]) == 0
    text = capfd.readouterr().out
    requirements = (requirement.label for requirement in REQUIREMENTS)
    imperfections = (imperfection.name for imperfection in IMPERFECTIONS)
    for word in (*requirements, *imperfections, "diverged", "✗", "0 of 6 rows"):
        assert word in text


def test_an_interrupt_ends_it_cleanly(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pidtsm_experiments.cli", "robustness", "--out", "mine"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + DEADLINE
    while not (tmp_path / "mine.unfinished").exists():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=DEADLINE)
    assert process.returncode == 130
    assert out == ""
    assert err.splitlines()[-1] == "pidtsm: interrupted"
    assert "Traceback" not in err
    assert not (tmp_path / "mine").exists()
