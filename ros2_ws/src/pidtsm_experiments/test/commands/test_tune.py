"""The command leaves gains that the other commands take, survives a kill, and gives the same bits on other workers."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.origin import ORIGIN, origin_of
from pidtsm_experiments.runs.ownership import MARKER

DEADLINE = 120.0
TUNE = ["tune", "--law", "computed_torque", "--hardware", "ideal", "--budget", "18", "--seed", "2"]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("tune") / "out"
    assert main([*TUNE, "--out", str(out)]) == 0
    return out


def found(out: Path) -> dict[str, Any]:
    content = json.loads((out / "tuning.json").read_text())
    return dict(content)


def test_the_results_are_written_and_taken(out: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert {file.name for file in out.iterdir()} == {
        "params.yaml",
        "tuning.json",
        "tuning.html",
        "history.jsonl",
        MARKER,
        ORIGIN,
    }
    content = found(out)
    assert content["objective"] == "balanced"
    rollout = ["rollout", "--params", str(out / "params.yaml"), "--json"]
    capfd.readouterr()
    assert main(rollout) == 0
    metrics = json.loads(capfd.readouterr().out)
    assert metrics["law"] == "computed_torque"
    assert metrics["rmse"] == content["training"]["nominal"]["after"]["rmse"]
    choices = "--robot two_link --law computed_torque --hardware ideal --objective balanced --seed 2"
    command = f"# ./pidtsm tune {choices} --budget {content['evaluations']}"
    assert (out / "params.yaml").read_text().splitlines()[0] == command
    origin = origin_of(out)
    assert origin is not None
    assert origin["seed"] == 2, "that of the search"
    assert origin["parameters"]["controller"]["law.name"] == "computed_torque"


def test_killed_and_resumed_it_finds_the_same(out: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    command = [sys.executable, "-m", "pidtsm_experiments.cli", *TUNE, "--out", str(again)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    history, end = again / "history.jsonl", time.monotonic() + DEADLINE
    while not history.exists() or history.read_bytes().count(b"\n") < 2:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=DEADLINE)
    assert not (again / "params.yaml").exists()
    assert main([*TUNE, "--out", str(again)]) == 0
    assert found(again) == found(out)
    assert (again / "params.yaml").read_bytes() == (out / "params.yaml").read_bytes()


def test_a_dask_scheduler_changes_no_bit(out: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        assert main([*TUNE, "--scheduler", cluster.scheduler_address, "--out", str(tmp_path / "dask")]) == 0
    assert found(tmp_path / "dask") == found(out)
