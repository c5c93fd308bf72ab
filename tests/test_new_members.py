"""``./pidtsm new``: packages of one's own, whose members every command and node knows once they are installed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pidtsm_experiments.cli import main

KINDS = ("law", "surface", "reaching", "reference", "disturbance")
INSTALLED = KINDS[:2] + KINDS[-1:]
CHOSEN = (
    *("--law", "sliding_mode", "--duration", "0.5"),
    *("--set", "controller.law.surface=my_surface", "--set", "controller.law.k3=2.0"),
    *("--set", "simulator.disturbance.name=my_disturbance", "--set", "simulator.disturbance.amplitude=2.0"),
)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One package of each kind."""
    folder = tmp_path_factory.mktemp("members")
    for kind in KINDS:
        assert main(["new", kind, f"my_{kind}", "--folder", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def installed(written: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Environment of processes that find the packages, as pip installs them."""
    target = tmp_path_factory.mktemp("site")
    packages = [str(written / f"my_{kind}") for kind in INSTALLED]
    options = ["--quiet", "--no-build-isolation", "--no-deps", "--no-index", "--target", str(target)]
    subprocess.run([sys.executable, "-m", "pip", "install", *options, *packages], check=True)
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(target), os.environ.get("PYTHONPATH", "")])}


def call(environment: dict[str, str], folder: Path, *words: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "pidtsm_experiments.cli", *words],
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_their_own_tests_pass(written: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", written, written],
        capture_output=True,
        text=True,
        cwd=written,
    )
    assert f"{len(KINDS)} passed" in done.stdout, done.stdout + done.stderr


def test_nodes_and_rollout_know_them_and_agree_bit_for_bit(installed: dict[str, str], tmp_path: Path) -> None:
    simulated = json.loads(call(installed, tmp_path, "rollout", *CHOSEN, "--json"))
    call(installed, tmp_path, "run", *CHOSEN, "--clock", "lockstep", "--out", "run")
    recorded = json.loads((tmp_path / "run" / "metrics.json").read_text(encoding="utf-8"))
    same = ("rmse", "max_error", "eci", "torque_variation")
    assert [recorded[name] for name in same] == [simulated[name] for name in same]


def test_a_score_takes_them(installed: dict[str, str], tmp_path: Path) -> None:
    call(installed, tmp_path, "score", "--law", "my_law", "--quick", "--out", "score")
    score = json.loads((tmp_path / "score" / "score.json").read_text(encoding="utf-8"))
    assert score["controller"]["law.name"] == "my_law"
    assert score["runs"] > 30


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["law", "pid"], "there is a law of this name already"),
        (["law", "My-Law"], "small letters, digits and underscores"),
        (["surface", "class"], "be no keyword"),
    ],
)
def test_a_name_that_cannot_be_used_is_refused(
    words: list[str], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", *words, "--folder", str(tmp_path)]) == 2
    assert reason in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_exists_stays_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine").mkdir()
    assert main(["new", "law", "mine", "--folder", str(tmp_path)]) == 2
    assert "exists" in capsys.readouterr().err
    assert not list((tmp_path / "mine").iterdir())
