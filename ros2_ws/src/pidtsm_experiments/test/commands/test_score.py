"""The command writes and prints its score, takes any law, and ends cleanly when interrupted."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pidtsm_core.experiment import make_experiment
from pidtsm_experiments.cli import main
from pidtsm_experiments.commands.score import name_of
from pidtsm_experiments.runs.origin import ORIGIN, origin_of
from pidtsm_experiments.runs.ownership import MARKER
from pidtsm_studies.score.plan import Contender

DEADLINE = 120.0
ALWAYS = (MARKER, ORIGIN)
"""Files of every result folder."""


@pytest.fixture(scope="module")
def scores(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the score of a law that is made of parts, as one's own are."""
    folder = tmp_path_factory.mktemp("scores")
    own = ["--law", "sliding_mode", "--set", "controller.law.surface=linear", "--name", "mine"]
    assert main(["score", "--quick", *own, "--out", str(folder / "mine")]) == 0
    return folder


def test_the_score_is_written(scores: Path) -> None:
    assert {file.name for file in (scores / "mine").iterdir()} == {"score.json", "report.html", *ALWAYS}
    content = json.loads((scores / "mine" / "score.json").read_text())
    assert (content["law"], content["name"], content["runs"]) == ("sliding_mode", "mine", 38)
    origin = origin_of(scores / "mine")
    assert origin is not None
    assert origin["parameters"]["controller"]["law.surface"] == "linear"
    assert origin["seed"] == origin["parameters"]["simulator"]["seed"]


def test_the_leaderboard_reads_it(scores: Path, tmp_path: Path) -> None:
    out = tmp_path / "board"
    assert main(["leaderboard", str(scores), "--out", str(out)]) == 0
    assert {file.name for file in out.iterdir()} == {"leaderboard.html", "leaderboard.md", "images", *ALWAYS}
    document = (out / "leaderboard.md").read_text()
    assert "| mine |" in document
    assert "**Quick scores**" in document
    origin = origin_of(out)
    assert origin is not None
    assert origin["runs"] == {str(scores / "mine"): origin_of(scores / "mine")}


@pytest.mark.parametrize(
    ("file", "name"), [("firm.yaml", "piddtsm firm"), ("panda-17bit/params.yaml", "piddtsm panda-17bit")]
)
def test_a_parameter_file_is_called_as_what_distinguishes_it(tmp_path: Path, file: str, name: str) -> None:
    path = tmp_path / file
    path.parent.mkdir(exist_ok=True)
    path.write_text("controller:\n  ros__parameters:\n    law.k1: 2.0\n")
    assert name_of(make_experiment("case1"), Contender(None, (str(path),))) == name


def test_an_interrupt_ends_it_cleanly(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pidtsm_experiments.cli", "score", "--out", "mine"]
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
    assert not (tmp_path / "mine").exists()
