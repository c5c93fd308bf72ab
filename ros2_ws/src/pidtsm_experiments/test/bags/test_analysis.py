"""metrics.json has the documented content and the numbers of the run."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pidtsm_core.recording import Recording
from pidtsm_core.recording.metrics import metrics
from pidtsm_core.recording.summary import write_metrics
from pidtsm_core.signals import Signal
from pidtsm_experiments.bags.analysis import analyze
from pidtsm_experiments.bags.reader import read_recording

KEYS = [
    "scenario",
    "law",
    "clock",
    "duration",
    "samples",
    "joints",
    "slides",
    "truth",
    "side",
    "lacking",
    "outcome",
    "strayed",
    "overloaded",
    "faults",
    "violations",
    "time_holding",
    "time_freedrive",
    "time_stopped",
    "max_error",
    "rmse",
    "eci",
    "steady_state_error",
    "settling_time",
    "torque_variation",
    "torque_variation_rate",
    "torque_jumps",
    "saturation",
    "time_at_effort_limit",
    "time_at_rate_limit",
    "time_at_barrier_limit",
    "adaptive_gain",
    "lost",
    "found",
    "rejected",
    "timing",
]


def test_a_bag_has_the_metrics_of_its_run(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    values = analyze(write_bag(tmp_path / "bag", run))
    assert list(values) == KEYS
    assert (values["scenario"], values["law"], values["clock"]) == ("case1", "piddtsm", "lockstep")
    assert (values["duration"], values["samples"], values["joints"]) == (2.0, 2000, ["joint1", "joint2"])
    expected = metrics(run.time, run.position - run.reference[:, 0], run.effort, run.signals[:, Signal.SATURATED])
    assert {name: values[name] for name in expected} == expected
    assert values["adaptive_gain"] == run.signals[-1, Signal.ADAPTIVE_GAIN].tolist()
    assert set(values["lost"].values()) == {0}
    assert values["timing"] == {
        "rate": pytest.approx(1000.0),
        "period_max": 0.001,
        "compute_time": {"p50": 2e-5, "p99": pytest.approx(2e-5), "max": 2e-5},
    }


def test_recovery_time_follows_settling_time(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    values = analyze(write_bag(tmp_path / "bag", run, metadata={"scenario": "case2", "event_time": 1.0}))
    order = list(values)
    assert order.index("recovery_time") == order.index("settling_time") + 1


def test_a_gap_is_seen_in_the_timing(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    path = write_bag(tmp_path / "bag", run, edit=lambda topic, k, m: None if 100 <= k < 150 else m)
    timing = analyze(path)["timing"]
    assert timing["period_max"] == 0.051
    assert timing["rate"] == pytest.approx(1949 / 1.999)


def test_one_sample_has_no_rate(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    recording = read_recording(write_bag(tmp_path / "bag", run, edit=lambda topic, k, m: m if k == 0 else None))
    values = recording.metrics()
    assert values["samples"] == 1
    assert values["timing"]["rate"] is None
    assert values["timing"]["period_max"] is None
    json.dumps(values, allow_nan=False)


def test_a_run_without_nodes_has_no_compute_time(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    recording = replace(read_recording(write_bag(tmp_path / "bag", run)), compute_time=np.empty(0))
    assert recording.metrics()["timing"]["compute_time"] == {"p50": None, "p99": None, "max": None}


def test_metrics_are_written_whole_or_not_at_all(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    values = analyze(write_bag(tmp_path / "bag", run))
    path = tmp_path / "metrics.json"
    write_metrics(values, path)
    assert json.loads(path.read_text()) == values
    assert list(json.loads(path.read_text())) == KEYS
    with pytest.raises(ValueError, match="nan"):
        write_metrics({**values, "duration": float("nan")}, path)
    assert json.loads(path.read_text()) == values
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bag", "metrics.json"]


def test_error_and_effort_are_those_of_the_ground_truth(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    """Even if the controller's state differs."""

    def edit(topic: str, k: int, message: Any) -> Any:
        wrong = np.array([7.0, 7.0])
        return replace(message, position_error=wrong, effort=wrong) if topic == "controller/state" else message

    values = analyze(write_bag(tmp_path / "bag", run, edit=edit))
    assert max(values["rmse"]) < 1.0
    assert values["eci"] == pytest.approx(np.abs(run.effort).mean(axis=0).tolist(), rel=1e-13)
