"""Two Dask workers on this machine compared with one, beside two processes without Dask compared with one."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace

import joblib
import numpy as np
from distributed import LocalCluster

from pidtsm_core.rollouts.batches import Settings, batch
from pidtsm_experiments.commands.bench import Row, medians
from pidtsm_experiments.commands.cluster import workers
from pidtsm_studies.score.tasks import find_task
from pidtsm_studies.tuning.space import make_space

TAKES = 260.0  # s


def run(quick: bool) -> Iterator[Row]:
    """Rollouts of tuning: the Panda with gains around the rule-based set."""
    count, duration, repetitions = (4, 0.1, 1) if quick else (72, 10.0, 5)
    settings = _candidates(count)
    with ExitStack() as stack:
        clusters = [stack.enter_context(_cluster(number)) for number in (1, 2)]
        one, two, alone, both = medians(
            repetitions,
            lambda: _with_dask(clusters[0], settings, duration),
            lambda: _with_dask(clusters[1], settings, duration),
            lambda: _without(1, settings, duration),
            lambda: _without(2, settings, duration),
        )
    name = f"{count} rollouts, {duration:g} s each"
    yield Row(f"{name}, 2 Dask workers", two, "s", "1 Dask worker", one, one / two, ">= 1.8")
    yield Row(f"{name}, 2 processes", both, "s", "1 process", alone, alone / both, note="without Dask, nothing shared")
    yield Row(f"{name}, 2 Dask workers", two, "s", "2 processes", both, two / both)


def _cluster(number: int) -> LocalCluster:
    return LocalCluster(
        n_workers=number, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0", host="127.0.0.1"
    )


def _with_dask(cluster: LocalCluster, settings: Sequence[Settings], duration: float) -> None:
    with workers(cluster.scheduler_address):
        batch(settings, duration)


def _without(processes: int, settings: Sequence[Settings], duration: float) -> None:
    parts = (joblib.delayed(batch)(settings[i::processes], duration, 1) for i in range(processes))
    joblib.Parallel(n_jobs=processes, backend="loky")(parts)


def _candidates(count: int) -> list[Settings]:
    task = find_task("panda")
    space, nominal = make_space(task, "piddtsm"), task.experiment("piddtsm")
    random = np.random.default_rng(0)
    points = np.clip(space.start + 0.03 * random.standard_normal((count, space.start.size)), 0.0, 1.0)
    controllers = ({"controller": space.controller(each)} for each in points)
    return [{"scenario": replace(nominal, settings={**nominal.settings, **each})} for each in controllers]
