"""Batches: same bits as single rollouts, for any workers; reports of failures; memory; interruption."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import joblib
import numpy as np
import pytest
from scipy import stats

from pidtsm_core.recording import Recording
from pidtsm_core.recording.metrics import JointMetrics, metrics
from pidtsm_core.rollouts.batches import BatchResult, batch
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Signal

DURATION = 0.2
GAINS: list[dict[str, Any]] = [{"controller": {"law.k1": 1.0 + 0.5 * i}} for i in range(9)]
UNKNOWN = {"controller": {"law.k9": 1.0}}
DIVERGING = {"controller": {"limits.effort": 1e-3}, "simulator": {"limits.effort": 1e-3, "rate": 1}}


def assert_same(result: BatchResult, other: BatchResult) -> None:
    """Compare bit by bit."""
    assert list(result.metrics) == list(other.metrics)
    for name, values in result.metrics.items():
        assert values.tobytes() == other.metrics[name].tobytes(), name
    assert result.failed == other.failed


@pytest.fixture(scope="module")
def serial() -> BatchResult:
    return batch([*GAINS, UNKNOWN], DURATION, workers=1)


def test_each_row_has_the_metrics_of_its_rollout(serial: BatchResult) -> None:
    for i, settings in enumerate(GAINS):
        run = rollout(**settings, duration=DURATION)
        found = metrics(
            run.time, run.position - run.reference[:, 0], run.effort, run.signals[:, Signal.SATURATED], None
        )
        assert set(found) == set(serial.metrics)
        for name, row in found.items():
            np.testing.assert_array_equal(serial.metrics[name][i], np.array(row, dtype=float), err_msg=name)


@pytest.mark.parametrize("workers", [2, 3, -1])
def test_the_number_of_workers_changes_no_bit(serial: BatchResult, workers: int) -> None:
    assert_same(batch([*GAINS, UNKNOWN], DURATION, workers), serial)


def test_a_backend_of_the_caller_changes_no_bit(serial: BatchResult) -> None:
    with joblib.parallel_config(backend="loky"):
        assert_same(batch([*GAINS, UNKNOWN], DURATION, workers=2), serial)


def test_a_dask_cluster_changes_no_bit(serial: BatchResult) -> None:
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster) as client,
        joblib.parallel_config(backend="dask", client=client),
    ):
        assert_same(batch([*GAINS, UNKNOWN], DURATION), serial)


def test_a_failed_run_is_reported_and_does_not_affect_the_others() -> None:
    result = batch([GAINS[0], UNKNOWN, DIVERGING, GAINS[0]], 1000.0 * 1e-3)
    assert list(result.failed) == [1]
    assert "law.k9" in result.failed[1]
    assert np.isnan(result.metrics["rmse"]).all(axis=1).tolist() == [False, True, False, False]
    np.testing.assert_array_equal(result.metrics["rmse"][0], result.metrics["rmse"][3])


def test_the_failure_of_a_diverging_run_includes_the_time() -> None:
    result = batch([DIVERGING], 1000.0)
    assert result.metrics == {}
    assert "not finite any more after" in result.failed[0]


def test_a_value_that_does_not_exist_is_nan() -> None:
    settled = batch([{}], 0.01).metrics["settling_time"]
    assert settled.shape == (1, 2)
    assert np.isnan(settled).all()


def test_recovery_is_there_with_an_event() -> None:
    load = {"payload.mass": 0.5, "payload.time": 0.1}
    recovery = batch([{}, {"simulator": load}], DURATION).metrics["recovery_time"]
    assert recovery.shape == (2, 2)
    assert np.isnan(recovery[0]).all()


def test_nothing_to_do_is_no_error() -> None:
    assert batch([], DURATION) == BatchResult({}, {}, [])


def test_trajectories_are_decimated_and_own_their_memory() -> None:
    result = batch([GAINS[1], UNKNOWN], DURATION, keep_every=10)
    run = rollout(**GAINS[1], duration=DURATION)
    kept, failed = result.trajectories
    assert failed is None
    assert kept is not None
    np.testing.assert_array_equal(kept.time, run.time[::10])
    np.testing.assert_array_equal(kept.error, (run.position - run.reference[:, 0])[::10])
    np.testing.assert_array_equal(kept.effort, run.effort[::10])
    assert kept.time.base is kept.error.base is kept.effort.base is None
    assert batch([GAINS[1]], DURATION).trajectories == []


def test_other_measures_stand_beside_the_metrics(serial: BatchResult) -> None:
    result = batch([*GAINS, UNKNOWN], DURATION, measure=lambda run: {"last": run.position[-1].tolist()})
    assert set(result.metrics) == {*serial.metrics, "last"}
    last = [rollout(**settings, duration=DURATION).position[-1] for settings in GAINS]
    np.testing.assert_array_equal(result.metrics["last"], [*last, [np.nan, np.nan]])


def test_a_negative_decimation_is_refused() -> None:
    with pytest.raises(ValueError, match="keep_every"):
        batch([{}], DURATION, keep_every=-1)


def test_settings_are_taken_a_few_at_a_time_and_progress_is_reported() -> None:
    taken = 0
    ahead: list[int] = []
    reported: list[int] = []

    def settings() -> Iterator[Any]:
        nonlocal taken
        for each in GAINS:
            taken += 1
            yield each

    def measure(_: Recording) -> JointMetrics:
        ahead.append(taken - len(ahead))
        return {}

    batch(settings(), DURATION, workers=2, progress=reported.append, measure=measure)
    assert reported == list(range(1, len(GAINS) + 1))
    # Per worker two at the start, and one that is ready when a run has ended.
    assert max(ahead) <= 6


def test_an_interrupt_ends_it_cleanly() -> None:
    # A process that a shell starts in the background ignores the signal at first.
    code = """
import signal
from itertools import repeat
from pidtsm_core.rollouts.batches import batch
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    batch(repeat({}), 1.0, progress=lambda done: print(done, flush=True))
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        begin = time.monotonic()
        rest = process.stdout.read().splitlines()
        assert rest[-1] == "interrupted"
        assert process.wait(timeout=30.0) == 0
        assert time.monotonic() - begin < 30.0


def test_a_mistyped_key_fails_one_run_and_not_the_batch() -> None:
    result = batch([{"law": "pid"}, {"lawr": "pid"}, {"law": "pid", "duration": 3.0}], 0.05, workers=1)
    assert set(result.failed) == {1, 2}
    assert result.failed[1].startswith("unknown argument lawr; known: scenario, law, params")
    assert result.failed[1].endswith("did you mean law?")
    assert "unknown argument duration" in result.failed[2]
    assert np.isfinite(result.metrics["rmse"][0]).all()


def test_a_batch_is_a_latex_table_with_intervals_over_its_seeds() -> None:
    settings: list[dict[str, Any]] = [
        {"law": law, "scenario": "noise", "simulator": {"seed": seed}} for law in ("pid", "dtsm") for seed in (1, 2, 3)
    ]
    result = batch(settings, 0.1)
    text = result.to_latex([each["law"] for each in settings], ("rmse", "recovery_time"), ("a_1", "b"))
    lines = [line for line in text.splitlines() if "&" in line]
    assert lines[0] == r"metric & joint & pid ($n = 3$) & dtsm ($n = 3$) \\"
    assert [line.split(" & ")[:2] for line in lines[1:]] == [["rmse", r"a\_1"], ["", "b"]]
    rmse = result.metrics["rmse"][:3, 0]
    low, high = stats.t.interval(0.95, 2, rmse.mean(), stats.sem(rmse))
    mean, half = map(float, lines[1].split(" & ")[2].strip("$").split(r" \pm "))
    assert (mean, half) == pytest.approx((rmse.mean(), (high - low) / 2), rel=0.05)
    with pytest.raises(ValueError, match="labels: 1 given, but there are 6 runs"):
        result.to_latex(["pid"])
