"""Half an hour at 1 kHz with the recorder: growth of memory, drift of errors, lost messages."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
from watching import Looks, watched

from pidtsm_core.experiment import PRACTICAL, make_experiment
from pidtsm_experiments.bags.reader import METRICS_ONLY, read_recording
from pidtsm_experiments.commands.bench import Row
from pidtsm_experiments.runs.runner import run as run_experiment

DURATION = 1800.0
"""s."""
_EVERY = 1.0  # s between two samples of the memory
_MINUTE = 60.0
_MEGABYTE = 1e6


def _own_memory(process: psutil.Process) -> float:
    return float(process.memory_full_info().uss)


def _growth(looks: Looks, minute: float) -> float:
    """Growth in MB/h: slope of a line fitted to all samples after the first minute of a process."""
    when, size = np.array([look for look in looks if look[0] >= looks[0][0] + minute]).T
    return float(np.polynomial.Polynomial.fit(when, size, 1).convert().coef[1]) * 3600.0 / _MEGABYTE


TAKES = 1860.0  # s


def run(quick: bool) -> Iterator[Row]:
    """Sinusoidal motion with 14-bit encoders, delay, losses and the practical parameters."""
    duration = 12.0 if quick else DURATION
    minute = min(_MINUTE, duration / 4.0)
    motion = ("trajectory.reference.name=sines",)
    experiment = make_experiment("loss", params=[PRACTICAL], overrides=motion, duration=duration)
    with tempfile.TemporaryDirectory(prefix="pidtsm-soak-") as folder:
        with watched(_own_memory, _EVERY) as memory:
            bag = run_experiment(experiment, "realtime", Path(folder), lambda _: None)
        recording = read_recording(bag, METRICS_ONLY)
    for name, looks in memory.items():
        growth = _growth(looks, minute)
        yield Row(f"memory of {name}: growth", growth, "MB/h", "allowed", 1.0, growth, "<= 1")
        yield Row(f"memory of {name}: at the end", looks[-1][1] / _MEGABYTE, "MB")

    found = recording.metrics()
    rate = found["timing"]["rate"]
    yield Row("deviation from 1000 Hz", abs(rate - 1000.0), "Hz", "allowed", 1.0, abs(rate - 1000.0), "<= 1")
    for topic, count in found["lost"].items():
        yield Row(f"{topic}: samples missing in the bag", count, "", note=f"of {found['samples']}")
    end = recording.time[-1]
    second = (recording.time >= minute) & (recording.time < 2 * minute)
    last = recording.time >= end - minute
    for joint, error in zip(recording.joints, recording.error.T, strict=True):
        early, late = (float(np.sqrt(np.mean(np.square(error[part])))) for part in (second, last))
        yield Row(f"RMSE of {joint}, last minute", late, "rad", "the second minute", early, late / early, "<= 1.1")
        largest = float(np.abs(error[recording.time >= minute]).max())
        yield Row(f"largest error of {joint} after the first minute", largest, "rad")
