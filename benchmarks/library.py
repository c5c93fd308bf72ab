"""The library in fresh processes: import, first rollout after an installation; and a call beside its compiled loop."""

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass

from pidtsm_core import rollout
from pidtsm_core.experiment import make_experiment
from pidtsm_core.rollouts import closed_loop
from pidtsm_experiments.commands.bench import Row, medians

ROLLOUT = "import pidtsm_core; pidtsm_core.rollout('case1', duration=1.0)"
TAKES = 45.0  # s


@dataclass(frozen=True)
class Spent:
    """Time and processor time of a process, s."""

    elapsed: float
    processor: float


def _python(code: str, cache: str) -> Spent:
    """A new interpreter that runs `code`, with its compiled functions in the folder `cache`."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment, stderr=subprocess.DEVNULL)
    elapsed, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Spent(elapsed, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def run(quick: bool) -> Iterator[Row]:
    """Fresh processes, then a warm call beside the compiled loop that it contains; a quick run compiles nothing."""
    duration, repetitions, processes = (1.0, 3, 1) if quick else (30.0, 15, 3)
    with tempfile.TemporaryDirectory() as fresh:
        cache = os.environ.get("NUMBA_CACHE_DIR", "") if quick else fresh
        first = _python(ROLLOUT, cache)
        second = min((_python(ROLLOUT, cache) for _ in range(processes)), key=lambda spent: spent.elapsed)
        compiler = min(_python("import numba", cache).elapsed for _ in range(processes))
        empty = min(_python("", cache).elapsed for _ in range(processes))
        package = min(_python("import pidtsm_core", cache).elapsed for _ in range(processes))
    yield Row("import pidtsm_core", package, "s", "Python alone", empty, package / empty)
    if not quick:
        name, note = "first rollout after an installation", f"{first.processor:.3g} s of processor time, with compiling"
        ratio = first.elapsed / second.elapsed
        yield Row(name, first.elapsed, "s", "second process", second.elapsed, ratio, None, note)
    ratio = second.elapsed / compiler
    yield Row("rollout in a second process", second.elapsed, "s", "import numba", compiler, ratio)

    experiment = make_experiment("case1", None, duration)
    values = experiment.values
    ready = [closed_loop._prepared(values, duration) for _ in range(repetitions + 1)]
    call, loop = medians(repetitions, lambda: rollout(experiment), lambda: closed_loop._run(*ready.pop()))
    yield Row(
        f"call of rollout, {duration:g} s of Case 1", call * 1e3, "ms", "its loop", loop * 1e3, call / loop, "<= 1.05"
    )
