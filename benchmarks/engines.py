"""MuJoCo next to the project's own engine: rollouts, recorded lockstep runs, and missed deadlines in real time."""

import re
import statistics
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader

from pidtsm_core.experiment import Experiment, make_experiment
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.simulation.mujoco_model import ENGINE
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.commands.bench import Row, medians
from pidtsm_experiments.runs.runner import run as run_experiment

TAKES = 300.0  # s
ROBOT = "panda"
_DONE = re.compile(r"done: (\d+) samples in ([\d.]+) s")
_MISSES = 1e-3
"""Share of missed deadlines that counts as none, so that the ratio of two small numbers means something."""


def run(quick: bool) -> Iterator[Row]:
    """The Panda in its default motion, with MuJoCo's default integrator."""
    seconds, repeats = (1.0, 1) if quick else (10.0, 5)
    ours, theirs = (_experiment(engine, seconds) for engine in ENGINE.choices)
    times = medians(repeats, lambda: rollout(theirs), lambda: rollout(ours))
    yield _speed(f"rollout of the {ROBOT} on MuJoCo", seconds, times, None)
    taken: dict[str, list[float]] = {engine: [] for engine in ENGINE.choices}
    for _ in range(1 if quick else 3):
        for engine, each in taken.items():
            each.append(_lockstep(_experiment(engine, seconds)))
    times = [statistics.median(each) for each in reversed(taken.values())]
    yield _speed(f"recorded lockstep run of the {ROBOT} on MuJoCo", seconds, times, ">= 0.5")
    long = 2.0 if quick else 60.0
    missed = [_missed(_experiment(engine, long)) for engine in reversed(tuple(ENGINE.choices))]
    ratio = (missed[0] + _MISSES) / (missed[1] + _MISSES)
    note = f"{long:g} s at 1 kHz, recorded; {_MISSES:g} is added to both for the ratio"
    yield Row(
        f"missed deadlines of the {ROBOT} on MuJoCo",
        missed[0],
        "of the periods",
        "own engine",
        missed[1],
        ratio,
        "<= 1.2",
        note,
    )


def _experiment(engine: str, seconds: float) -> Experiment:
    return make_experiment(None, duration=seconds, overrides={"simulator": {ENGINE.name: engine}}, robot=ROBOT)


def _speed(name: str, seconds: float, times: list[float], target: str | None) -> Row:
    """Simulated seconds per second of MuJoCo and of the own engine."""
    theirs, ours = (seconds / time for time in times)
    return Row(name, theirs, "simulated s/s", "own engine", ours, theirs / ours, target)


def _lockstep(experiment: Experiment) -> float:
    """Wall time of a lockstep run without its start, s."""
    with tempfile.TemporaryDirectory(prefix="pidtsm-bench-") as name:
        run_experiment(experiment, "lockstep", Path(name), lambda _: None)
        done = _DONE.search(Path(name, "log", "simulator.log").read_text(encoding="utf-8"))
    if done is None:
        raise RuntimeError("the simulator did not log that it is done")
    return float(done[2])


def _missed(experiment: Experiment) -> float:
    """Share of the controller's periods that missed their deadline in a run in real time."""
    with tempfile.TemporaryDirectory(prefix="pidtsm-bench-") as name:
        bag = run_experiment(experiment, "realtime", Path(name), lambda _: None)
        with AnyReader([bag], default_typestore=typestore()) as reader:
            topics = [c for c in reader.connections if c.topic == "/controller/state"]
            *_, (connection, _, data) = reader.messages(topics)
            state: Any = reader.deserialize(data, connection.msgtype)
            count = sum(c.msgcount for c in topics)
    return float(state.missed_deadlines) / count
