"""Batches of rollouts: all cores compared with one, and time against the number of rollouts."""

import os
from collections.abc import Iterator

from pidtsm_core.rollouts.batches import Settings, batch
from pidtsm_experiments.commands.bench import Row, medians

TAKES = 180.0  # s


def run(quick: bool) -> Iterator[Row]:
    """Rollouts of 30 s for the speed-up, of 3 s for the time against their number."""
    runs, duration, largest = (16, 1.0, 10) if quick else (1000, 30.0, 10_000)
    one, every = medians(1, lambda: batch(_varied(runs), duration, 1), lambda: batch(_varied(runs), duration))
    cores = os.cpu_count() or 1
    name = f"batch of {runs}, {duration:g} s each, {cores} cores"
    target = ">= 1.8" if cores == 2 else None
    yield Row(name, every, "s", "one core", one, one / every, target)
    short = duration / 10
    single = medians(5, lambda: batch(_varied(1), short))[0]
    count = 1
    while count <= largest:
        (seconds,) = medians(1, lambda count=count: batch(_varied(count), short))  # type: ignore[misc]
        share = seconds / count
        yield Row(
            f"rollout of {short:g} s in a batch of {count}", share * 1e3, "ms", "alone", single * 1e3, share / single
        )
        count *= 10


def _varied(count: int) -> Iterator[Settings]:
    """Gains and model errors that differ from run to run."""
    for i in range(count):
        yield {"controller": {"law.k1": 2.0 + 2.0 * i / count, "robot.m2": 1.2 + 0.6 * (i * 7 % count) / count}}
