"""The article's evaluation over real nodes: every law agrees with its rollout, and an interrupted call is taken up."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
import weakref
from pathlib import Path

import numpy as np
import pytest
from support.nursery import begin

from pidtsm_core.experiment import make_experiment
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.reproduction import Planned, make_runs, plan
from pidtsm_experiments.runs.runner import run

DEADLINE = 300.0
LAWS = ("piddtsm", "pidnftsm", "dtsm", "dtsm_printed")
"""Of the article, without the baselines."""


def test_the_plan_is_the_articles_evaluation_with_baselines() -> None:
    keys = {p.key for p in plan()}
    laws = ("piddtsm", "pidnftsm", "dtsm", "pid", "computed_torque", "super_twisting")
    assert keys == {f"{case}-{law}" for case in ("case1", "case2") for law in laws} | {"case1-dtsm_printed"}
    assert all(p.experiment.duration == 30.0 for p in plan())


def test_a_part_of_the_plan_has_its_parameters() -> None:
    (only,) = plan(2.0, ["case2"], ["dtsm"], overrides=["controller.law.k1=4.0"])
    every = plan(2.0, laws=["piddtsm", "dtsm_printed"], overrides=["controller.law.k1=4.0"])
    assert [p.key for p in (only, *every)] == ["case2-dtsm", "case1-piddtsm", "case2-piddtsm", "case1-dtsm_printed"]
    assert all(p.experiment.settings["controller"]["law.k1"] == 4.0 for p in (only, *every))
    assert every[-1].experiment.settings["controller"]["law.kappa"] == 0.01


@pytest.mark.parametrize("planned", [p for p in plan() if p.scenario == "case2"], ids=lambda p: p.law)
def test_nodes_and_rollout_agree_to_the_last_bit_for_every_law(planned: Planned, tmp_path: Path) -> None:
    # Case 2 with an early load step, so that both halves of the case are run.
    experiment = make_experiment("case2", planned.experiment.law, 0.5, overrides=["simulator.payload.time=0.3"])
    recording = read_recording(run(experiment, "lockstep", tmp_path, lambda _: None))
    offline = rollout(experiment)
    assert recording.time.size == 500
    for name in ("position", "velocity", "effort", "reference", "signals"):
        np.testing.assert_array_equal(getattr(recording, name), getattr(offline, name), err_msg=name)


PROGRAM = """
import sys
from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.reproduction import PRELOADED
PRELOADED.append("support.forked_runs")
sys.exit(main(["reproduce", "--out", "all", "--duration", "0.2", *sys.argv[1:]]))
"""


def reproduce(*words: str, cwd: Path) -> "subprocess.Popen[str]":
    """The command, whose runs fork their nodes."""
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-c", PROGRAM, *words]
    environment = {**os.environ, "PYTHONPATH": path}
    return subprocess.Popen(
        command, cwd=cwd, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def finished(folder: Path) -> dict[str, float]:
    files = folder.glob("all/runs/*/metrics.json")
    return {file.parent.name: file.stat().st_mtime for file in files if not file.parent.suffix}


def descendants(pid: int) -> set[int]:
    found: set[int] = set()
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, task.read_text().split()):
            found |= {child} | descendants(child)
    return found


def test_an_interrupted_reproduction_is_taken_up(tmp_path: Path) -> None:
    words = [word for law in LAWS for word in ("--law", law)]
    process = reproduce(*words, cwd=tmp_path)
    end = time.monotonic() + DEADLINE
    while len(finished(tmp_path)) < 2:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end, "no run was finished"
        time.sleep(0.05)
    everything = descendants(process.pid)
    assert everything
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=DEADLINE)
    assert process.returncode == 130
    assert "Traceback" not in err
    # multiprocessing's own helper notices the end of its parent a moment later.
    while any(Path(f"/proc/{pid}").exists() for pid in everything):
        assert time.monotonic() < end, "processes outlive the command"
        time.sleep(0.05)
    kept = finished(tmp_path)

    process = reproduce(*words, "--resume", cwd=tmp_path)
    _, err = process.communicate(timeout=DEADLINE)
    assert process.returncode == 0, err
    done = finished(tmp_path)
    assert done.keys() == {p.key for p in plan(laws=LAWS)}
    assert {key: done[key] for key in kept} == kept, "finished runs are not made again"

    folder = tmp_path / "all"
    results = json.loads((folder / "results.json").read_text())
    assert results["runs"].keys() == done.keys()
    for key, metrics in results["runs"].items():
        if "failed" not in metrics:
            assert metrics == json.loads((folder / "runs" / key / "metrics.json").read_text())
    assert results["comparison"]
    assert "| article |" in (folder / "comparison.md").read_text()
    assert (folder / "report.html").stat().st_size > 100_000
    names = {f"figure{number:02}.{kind}" for number in range(3, 13) for kind in ("png", "svg")}
    assert names <= {file.name for file in (folder / "figures").iterdir()}


def test_an_interrupt_while_the_process_of_a_run_is_deleted_is_not_lost(tmp_path: Path) -> None:
    """An exception is ignored there, so it would be lost if it was raised at once."""
    begin()
    deleted: list[int] = []

    def interrupt(process: int) -> None:
        deleted.append(process)
        os.kill(os.getpid(), signal.SIGINT)

    def progress(_key: str, _time: float) -> None:
        for process in multiprocessing.active_children():
            if process.pid is not None and process.pid not in watched:
                watched.add(process.pid)
                weakref.finalize(process, interrupt, process.pid).atexit = False

    watched: set[int] = set()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            make_runs(plan(0.2, laws=["piddtsm", "dtsm"]), tmp_path, 1, False, progress)
    finally:
        signal.signal(signal.SIGINT, before)
    assert deleted
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("law", ["pid", "sliding_mode"])
def test_a_law_that_the_article_does_not_have_is_refused(law: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rollout", "--law", law, "--params", "article"]) == 2
    assert f"the article has no parameters for {law}" in capsys.readouterr().err
