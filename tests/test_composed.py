"""Simulator, trajectory and controller in one process: the same nodes, the same results."""

import signal
from pathlib import Path

import numpy as np
import pytest
from lifecycle_msgs.srv import GetState
from support.testbed import Testbed

from pidtsm_core.experiment import make_experiment
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.runs.runner import run

NODES = ("simulator", "trajectory", "controller")


def test_composed_lockstep_is_the_rollout_to_the_last_bit(tmp_path: Path) -> None:
    experiment = make_experiment("case1", "piddtsm", duration=3.0)
    recording = read_recording(run(experiment, "lockstep", tmp_path, lambda _: None, composed=True))
    expected = rollout(experiment, duration=3.0)
    np.testing.assert_array_equal(recording.stamps_ns, np.arange(3000) * 1_000_000)
    assert not any(recording.lost.values())
    for name in ("position", "velocity", "effort", "reference", "signals"):
        np.testing.assert_array_equal(getattr(recording, name), getattr(expected, name), err_msg=name)


def test_composed_realtime_completes(tmp_path: Path) -> None:
    experiment = make_experiment("case1", "piddtsm", duration=2.0, overrides=["simulator.rate=250"])
    recording = read_recording(run(experiment, "realtime", tmp_path, lambda _: None, composed=True))
    assert np.all(np.isfinite(recording.effort))
    assert np.all(np.diff(recording.stamps_ns) > 0)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_all_of_them_cleanly(testbed: Testbed, number: signal.Signals) -> None:
    process = testbed.start("composed")

    def active(node: str) -> bool:
        return bool(testbed.call(GetState, f"{node}/get_state", GetState.Request()).current_state.label == "active")

    testbed.spin_until(lambda: all(active(node) for node in NODES), "all nodes are active")
    process.process.send_signal(number)
    assert process.wait() == 0
    assert "Traceback" not in process.log.read_text()


def test_a_bad_parameter_is_one_line(testbed: Testbed) -> None:
    file = testbed.folder / "params.yaml"
    file.write_text("controller:\n  ros__parameters:\n    law:\n      k1: -3.0\n")
    process = testbed.processes.start(
        "composed", ["--params-file", str(file)], testbed.environment, testbed.folder / "composed.log"
    )
    assert process.wait() == 2
    lines = process.log.read_text().splitlines()
    assert len(lines) == 1
    assert "law.k1: -3.0 must be >= 0" in lines[0]
