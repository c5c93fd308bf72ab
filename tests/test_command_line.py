"""The command line as a user meets it: results, errors in one line, exit codes, Ctrl-C, dying nodes."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.nursery import forked_command

from pidtsm_experiments.cli import main
from pidtsm_experiments.commands import cluster

DEADLINE = 120.0
Call = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """A command with its words, in the folder of the test and in this process."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cluster, "TIMEOUT", 1.0)

    def call(*words: str) -> "subprocess.CompletedProcess[str]":
        try:
            code = main(words)
        except SystemExit as end:  # argparse, after --help
            code = int(end.code or 0)
        return subprocess.CompletedProcess(words, code, *capsys.readouterr())

    return call


def start(*words: str, cwd: Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "pidtsm_experiments.cli", *words],
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for(path: Path, process: Any) -> None:
    end = time.monotonic() + DEADLINE
    while not path.exists():
        assert time.monotonic() < end, f"{path} did not appear"
        assert process.poll() is None, f"the command has ended before {path} appeared"
        time.sleep(0.02)


def name_of(pid: int) -> str:
    words = Path(f"/proc/{pid}/cmdline").read_text().split("\0")
    return next((word.rpartition("/")[2] for word in words if "/lib/" in word and "python" not in word), str(pid))


SEPARATE: tuple[str, ...] = ("recorder", "simulator", "controller", "trajectory")
COMPOSED = ("recorder", "composed")


def nodes_of(runner: "subprocess.Popen[str]", folder: Path, names: tuple[str, ...] = SEPARATE) -> dict[str, int]:
    """The processes of a run by name, once all are there."""
    for name in names:
        wait_for(folder / "log" / f"{name}.log", runner)
    end = time.monotonic() + DEADLINE
    while True:
        pids = Path(f"/proc/{runner.pid}/task/{runner.pid}/children").read_text().split()
        nodes = {name_of(int(pid)): int(pid) for pid in pids}
        if len(nodes) == len(names):
            return nodes
        assert time.monotonic() < end, nodes
        time.sleep(0.02)


BAD_USAGE = [
    ([], "usage"),
    (["fly"], "there is no command fly (./pidtsm --help lists all)"),
    (["rolout"], "there is no command rolout; did you mean rollout? (./pidtsm --help lists all)"),
    (["run", "--law", "pidtsm"], "unknown law pidtsm; known: computed_torque, disturbance_observer, dtsm"),
    (["run", "--scenario", "case9"], "no scenario case9: neither a file nor one of case1, case2"),
    (["run", "--duration", "-1"], "'-1' is not a positive number of seconds"),
    (["run", "--clock", "sundial"], "invalid choice: 'sundial'"),
    (["run", "--set", "controller.law.kk=1"], "controller: unknown parameter law.kk; did you mean law.k?"),
    (["run", "--set", "controller.law.k1=-1"], "controller: law.k1: -1 must be >= 0"),
    (["demo", "elsewhere"], "unrecognized arguments: elsewhere; see ./pidtsm demo --help"),
    (["run", "--set", "law.k1=1"], "must be NODE.PARAMETER=VALUE"),
    (["run", "--set", "controller.law.k1=[1"], "is not a valid value"),
    (["run", "--params", "nowhere.yaml"], "nowhere.yaml: No such file or directory"),
    (
        ["rollout", "--params", "adaptiv"],
        "one of article, practical, adaptive, tuned and tuned_14bit; did",
    ),
    (["run", "--out", "occupied"], "contains other files (thesis.tex)"),
    (["run", "--set", "controller.state.decimation=10"], "a recorded run requires 1, not 10"),
    (
        ["run", "--set", "trajectory.joints=[shoulder, elbow]"],
        "trajectory: joints are shoulder, elbow; those of the controller are joint1, joint2",
    ),
    (
        ["rollout", "--set", "controller.estimator.bandwidth=30"],
        "bandwidth belongs to estimator.name elastic_joint_observer or",
    ),
    (["rollout", "--set", "controller.estimator.velocity_cutoff=0"], "velocity_cutoff (rad/s): 0 must be > 0"),
    (["reproduce", "--scenario", "noise"], "noise is not part of the article's evaluation: case1, case2"),
    (["reproduce", "--law", "sliding_mode"], "law sliding_mode is not part of the article's evaluation: piddtsm,"),
    (["reproduce", "--law", "dtsm_printed", "--scenario", "case2"], "only in case1"),
    (["reproduce", "--law", "pid", "--set", "controller.law.k9=1"], "unknown parameter law.k9"),
    (["score", "--law", "mine"], "unknown law mine; known: computed_torque, disturbance_observer, dtsm,"),
    (["score", "--robot", "pandda"], "pandda: No such file or directory; neither a file nor one of two_link, panda,"),
    (["score", "--set", "controller.law.k9=1"], "unknown parameter law.k9"),
    (["tune", "--budget", "soon"], "'soon' is neither a time (90s, 10min, 1h) nor a number of controllers"),
    (["tune", "--seed", "-1"], "'-1' is not an integer from 0 to 2^32 - 1"),
    (["tune", "--law", "mine"], "unknown law mine; known: computed_torque, disturbance_observer, dtsm,"),
    (
        ["tune", "--budget", "9", "--scheduler", "tcp://127.0.0.1:1", "--out", "x"],
        "no scheduler answers",
    ),
    (["limit", "--scenario", "case9"], "no scenario case9"),
    (["leaderboard", "occupied"], "occupied: no score.json below this folder"),
    (["analyze", "nowhere"], "nowhere"),
    (["analyze", "occupied"], "occupied"),
]


@pytest.mark.parametrize(("words", "cause"), BAD_USAGE, ids=[" ".join(words) for words, _ in BAD_USAGE])
def test_bad_usage_is_one_clear_error(words: list[str], cause: str, tmp_path: Path, call: Call) -> None:
    (tmp_path / "occupied").mkdir()
    (tmp_path / "occupied" / "thesis.tex").write_text("years of work")
    result = call(*words)
    assert result.returncode == 2
    assert cause in (result.stderr or result.stdout)
    assert "Traceback" not in result.stderr
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["occupied", "thesis.tex"], "nothing is half done"


SCENARIO = """\
description: a lighter arm
duration: 0.2
simulator:
  robot:
    m2: 1.0
"""


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (("duration: 0.2", "duration: soon"), "mine.yaml: duration: 'soon' must be a positive number of seconds"),
        (("simulator:", "plant:"), "mine.yaml: unknown key plant; allowed: description, duration, simulator"),
        (("m2: 1.0", "m3: 1.0"), "mine.yaml: simulator: unknown parameter robot.m3; did you mean robot.m"),
        (("m2: 1.0", "m2: heavy"), "mine.yaml: simulator: robot.m2 (kg): 'heavy' must be a number"),
        (("description", "[description"), "mine.yaml is not YAML"),
    ],
)
def test_mistake_in_a_scenario_file_is_named(change: tuple[str, str], cause: str, tmp_path: Path, call: Call) -> None:
    (tmp_path / "mine.yaml").write_text(SCENARIO)
    assert call("rollout", "--scenario", "mine.yaml").returncode == 0
    (tmp_path / "mine.yaml").write_text(SCENARIO.replace(*change))
    result = call("rollout", "--scenario", "mine.yaml")
    assert result.returncode == 2
    assert cause in result.stderr


def test_run_leaves_a_complete_result_while_another_is_refused_and_analyze_repeats_it(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, call: Call
) -> None:
    log = tmp_path_factory.mktemp("log") / "run.log"
    words = ("run", "--scenario", "case2", "--duration", "0.5", "--out", "mine")
    first = forked_command(words, tmp_path, dict(os.environ), log)
    wait_for(tmp_path / "mine.unfinished", first)
    second = call("run", "--out", "mine")
    assert second.returncode == 2
    assert f"mine is being written by process {first.pid}" in second.stderr
    assert first.wait(DEADLINE) == 0, log.read_text()
    assert "RMSE" in log.read_text()
    folder = tmp_path / "mine"
    metrics = json.loads((folder / "metrics.json").read_text())
    assert (metrics["scenario"], metrics["law"], metrics["clock"]) == ("case2", "piddtsm", "lockstep")
    assert {p.name for p in (folder / "params").iterdir()} == {"simulator.yaml", "controller.yaml", "trajectory.yaml"}
    figures = {p.name for p in (folder / "figures").iterdir()}
    for name in ("tracking", "error", "torque", "sliding_variables", "adaptive_gain"):
        assert {f"{name}.png", f"{name}.svg"} <= figures
    again = call("analyze", "mine/bag", "--json")
    assert again.returncode == 0
    assert json.loads(again.stdout) == metrics
    assert [p.name for p in tmp_path.iterdir()] == ["mine"], "no litter"


def test_rollout_prints_one_json_object(tmp_path: Path, call: Call) -> None:
    result = call("rollout", "--duration", "0.1", "--set", "controller.estimator.name=exact", "--json")
    assert result.returncode == 0
    metrics = json.loads(result.stdout)
    assert metrics["samples"] == 100
    assert metrics["settling_time"] == [None, None]
    assert not list(tmp_path.iterdir())


IMPERFECT = (
    *("--set", "simulator.delay.samples=30"),
    *("--set", "simulator.dropout.probability=0.05"),
    *("--set", "simulator.dropout.burst_rate=5.0"),
    *("--set", "simulator.dropout.burst=20"),
    *("--set", "trajectory.dropout.time=0.2"),
    *("--set", "trajectory.dropout.duration=0.25"),
    *("--set", "controller.limits.tracking_error=[0.0, 0.3]"),
    *("--set", "trajectory.jump.time=0.7"),
    *("--set", "trajectory.jump.position=[0.0, 0.5]"),
    *("--set", "controller.rehearsal.reset_fault=0.8"),
    *("--set", "controller.activation.blend=0.5"),
)
"""Measurements and references that stay out, and a fault that is reset."""


def test_run_and_rollout_tell_the_same_to_the_last_digit(tmp_path: Path, call: Call) -> None:
    words = ("--duration", "1", *IMPERFECT)
    run, rollout = call("run", "--out", "mine", *words), call("rollout", "--json", *words)
    of_bag, simulated = json.loads((tmp_path / "mine" / "metrics.json").read_text()), json.loads(rollout.stdout)
    assert set(of_bag["rejected"]) >= {"controller", "simulator"}
    assert set(of_bag["rejected"].values()) == {0}
    assert set(of_bag["lost"].values()) == {0}
    (fault,) = of_bag["faults"]
    assert (fault["fault"], fault["joint"]) == ("tracking_limit", "joint2")
    assert fault["time"] < 0.8 < fault["reset"]
    assert of_bag["time_holding"] > 0.0
    of_nodes = ("clock", "lost", "rejected", "timing")
    assert {key: of_bag[key] for key in of_bag if key not in of_nodes} == {
        key: simulated[key] for key in simulated if key not in of_nodes
    }
    assert (run.returncode, rollout.returncode) == (0, 0), run.stderr + rollout.stderr


STOPPING = ("--duration", "0.2", "--set", "controller.limits.tracking_error=0.3")
REASON = "pidtsm: stopped at 0 s: joint1 is beyond limits.tracking_error"


def test_a_run_that_stops_is_reported_whole_and_has_failed(tmp_path: Path, call: Call) -> None:
    result = call("run", "--out", "mine", *STOPPING)
    assert result.returncode == 1
    assert result.stderr.splitlines()[-1] == REASON
    assert "stopped at 0 s: joint1 is beyond limits.tracking_error" in result.stdout
    assert [p.name for p in tmp_path.iterdir()] == ["mine"]
    assert json.loads((tmp_path / "mine" / "metrics.json").read_text())["outcome"] == "stopped"
    assert "What happened" in (tmp_path / "mine" / "report.html").read_text()
    again = call("analyze", "mine/bag", "--json")
    assert (again.returncode, again.stderr) == (0, "")
    assert json.loads(again.stdout)["outcome"] == "stopped"


def test_a_rollout_that_stops_has_failed(tmp_path: Path, call: Call) -> None:
    result = call("rollout", "--json", *STOPPING)
    assert result.returncode == 1
    assert result.stderr.splitlines() == [REASON]
    assert json.loads(result.stdout)["outcome"] == "stopped"


def test_what_is_allowed_but_unwise_is_said_before_the_start(tmp_path: Path, call: Call) -> None:
    result = call("rollout", "--duration", "0.05", "--set", "controller.limits.effort_rate=20.0")
    assert result.stderr.startswith("pidtsm: warning: limits.effort_rate of joint1 is 20 N m/s")


def test_the_order_of_settings_is_in_the_help(call: Call) -> None:
    for command in ("run", "rollout"):
        assert (
            "Precedence, lowest first: scenario, --robot, --hardware, --params, --law, --set."
            in call(command, "--help").stdout
        )


@pytest.mark.parametrize(
    ("number", "words", "names"), [(signal.SIGINT, (), SEPARATE), (signal.SIGTERM, ("--composed",), COMPOSED)]
)
def test_interrupt_ends_everything(
    number: signal.Signals, words: tuple[str, ...], names: tuple[str, ...], tmp_path: Path
) -> None:
    process = start("run", *words, "--out", "mine", cwd=tmp_path)
    nodes = nodes_of(process, tmp_path / "mine.unfinished", names).values()
    process.send_signal(number)
    _, err = process.communicate(timeout=DEADLINE)
    assert process.returncode == 130
    assert err.splitlines()[-1] == "pidtsm: interrupted"
    assert "Traceback" not in err
    assert not any(Path(f"/proc/{pid}").exists() for pid in nodes)


@pytest.mark.parametrize(
    ("victim", "words", "names"), [("controller", (), SEPARATE), ("recorder", ("--composed",), COMPOSED)]
)
def test_a_dying_node_is_named(victim: str, words: tuple[str, ...], names: tuple[str, ...], tmp_path: Path) -> None:
    process = start("run", *words, "--out", "mine", cwd=tmp_path)
    nodes = nodes_of(process, tmp_path / "mine.unfinished", names)
    os.kill(nodes[victim], signal.SIGKILL)
    _, err = process.communicate(timeout=DEADLINE)
    assert process.returncode == 1
    assert f"{victim} was killed by signal 9; its last lines:" in err
    assert not any(Path(f"/proc/{pid}").exists() for pid in nodes.values())
    assert not (tmp_path / "mine").exists()
    assert (tmp_path / "mine.failed" / "log" / f"{victim}.log").exists()


def test_nodes_end_with_a_killed_runner(tmp_path: Path) -> None:
    process = start("run", "--composed", "--out", "mine", cwd=tmp_path)
    nodes = nodes_of(process, tmp_path / "mine.unfinished", COMPOSED).values()
    process.kill()
    process.communicate()
    end = time.monotonic() + DEADLINE
    while any(Path(f"/proc/{pid}").exists() for pid in nodes):
        assert time.monotonic() < end, "nodes outlive the runner"
        time.sleep(0.05)
