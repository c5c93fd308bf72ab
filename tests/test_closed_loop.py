"""The main job: Case 1 over the real nodes, recorded, against the rollout and the article."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from pidtsm_core.rollout import Rollout, rollout
from pidtsm_experiments.analysis import summarize
from pidtsm_experiments.experiment import Experiment, make_experiment
from pidtsm_experiments.recording import Recording, read_recording
from pidtsm_experiments.runner import run

SAMPLES = 30_000


def record(experiment: Experiment, clock: str, folder: Path) -> Path:
    times: list[float] = []
    bag = run(experiment, clock, folder, times.append)
    assert times, "no progress was shown"
    assert times == sorted(times)
    return bag


@pytest.fixture(scope="module")
def demo_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(make_experiment("case1", "piddtsm"), "lockstep", tmp_path_factory.mktemp("demo"))


@pytest.fixture(scope="module")
def demo(demo_bag: Path) -> Recording:
    return read_recording(demo_bag)


def assert_same_bits(recording: Recording, other: Recording | Rollout) -> None:
    np.testing.assert_array_equal(recording.position, other.position)
    np.testing.assert_array_equal(recording.velocity, other.velocity)
    np.testing.assert_array_equal(recording.effort, other.effort)
    np.testing.assert_array_equal(recording.reference, other.reference)
    np.testing.assert_array_equal(recording.signals, other.signals)


def test_tracks_as_well_as_the_article(demo: Recording) -> None:
    metrics = summarize(demo)
    assert 0.0376 <= metrics["rmse"][0] <= 0.0385
    assert 0.0083 <= metrics["rmse"][1] <= 0.0093
    assert metrics["steady_state_error"][0] <= 7e-4
    assert metrics["steady_state_error"][1] <= 2e-5
    assert metrics["eci"] == pytest.approx([31.19, 12.03], rel=0.01)
    assert max(metrics["adaptive_gain"]) <= 20.0


def test_bag_holds_every_sample(demo_bag: Path, demo: Recording) -> None:
    with AnyReader([demo_bag]) as reader:
        counts = Counter({c.topic: c.msgcount for c in reader.connections})
    topics = ("/joint_states", "/joint_commands", "/reference", "/controller/state", "/simulator/ground_truth")
    assert counts == dict.fromkeys(topics, SAMPLES)
    assert not any(demo.lost.values()), "every stamp of the ground truth has its partners"
    np.testing.assert_array_equal(demo.stamps_ns, np.arange(SAMPLES) * 1_000_000)


def test_nodes_and_rollout_agree_to_the_last_bit(demo: Recording) -> None:
    assert_same_bits(demo, rollout(make_experiment("case1", "piddtsm").settings, 30.0))


def test_two_lockstep_runs_are_identical(demo: Recording, tmp_path: Path) -> None:
    bag = record(make_experiment("case1", "piddtsm"), "lockstep", tmp_path)
    assert_same_bits(read_recording(bag), demo)


def test_parameters_left_behind_reproduce_the_run(tmp_path: Path) -> None:
    overrides = ["controller.law.k1=[3.0, 2.5]", "simulator.payload.mass=0.5", "simulator.payload.time=0.2"]
    first = make_experiment("case1", "piddtsm", duration=0.5, overrides=overrides)
    (tmp_path / "a").mkdir()
    bag = record(first, "lockstep", tmp_path / "a")
    params = tmp_path / "all.yaml"
    params.write_text("".join(f.read_text() for f in sorted((tmp_path / "a" / "params").glob("*.yaml"))))
    again = make_experiment("case1", "piddtsm", duration=0.5, params=[str(params)])
    (tmp_path / "b").mkdir()
    assert_same_bits(read_recording(record(again, "lockstep", tmp_path / "b")), read_recording(bag))


def test_realtime_completes(tmp_path: Path) -> None:
    recording = read_recording(record(make_experiment("case1", "piddtsm", duration=3.0), "realtime", tmp_path))
    assert recording.clock == "realtime"
    assert np.all(np.isfinite(recording.effort))
    # Released from its brakes the arm is driven to the reference, not dropped.
    assert np.abs(recording.error[-1]).max() < np.abs(recording.error[0]).max() / 2
