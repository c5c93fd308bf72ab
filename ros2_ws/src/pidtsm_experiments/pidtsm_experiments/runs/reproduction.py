"""The article's evaluation: the list of its runs, and making them in parallel."""

import json
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.context import ForkServerProcess
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import Experiment, article_parameters, make_experiment
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_core.recording.summary import write_metrics
from pidtsm_experiments.bags.errors import RecordingError
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.runs.results import result_folder
from pidtsm_experiments.runs.runner import node_parameters, recorded_parameters, run, uninterrupted
from pidtsm_studies.article.claims import ARTICLE_LAWS, Comparison, as_json

SCENARIOS = ("case1", "case2")
BASELINES = ("pid", "computed_torque", "super_twisting")
PRINTED_DTSM = "dtsm_printed"
"""DTSM with kappa as printed in Table 1, only in Case 1, to show why another value is used."""
LAWS = (*ARTICLE_LAWS, *BASELINES, PRINTED_DTSM)

PRELOADED = [__name__]
"""Modules that are imported once, not for every run."""
_POLL = 0.1  # s

Progress = Callable[[str, float], None]
"""Called with the key of a run and the simulated time recorded so far, s."""


@dataclass(frozen=True)
class Planned:
    """A run of the reproduction.

    Attributes:
        scenario: name of the scenario.
        law: name in tables and figures.
        experiment: definition of the run.
    """

    scenario: str
    law: str
    experiment: Experiment

    @property
    def key(self) -> str:
        """Name of the run, and of its folder."""
        return f"{self.scenario}-{self.law}"


def plan(
    duration: float | None = None,
    scenarios: Sequence[str] = (),
    laws: Sequence[str] = (),
    params: Sequence[str] = (),
    overrides: Sequence[str] = (),
) -> list[Planned]:
    """The runs: the article's laws and the baselines in both cases, and DTSM as printed.

    Args:
        duration: s; replaces that of the scenarios, only for a quick look.
        scenarios: some of `SCENARIOS`; empty: all.
        laws: some of `LAWS`; empty: all.
        params: parameter sets for every run, after those of the article, see `make_experiment`.
        overrides: likewise.

    Raises:
        UsageError: a scenario or law that is not part of the evaluation, no run, or see `recorded_parameters`.
    """
    for what, chosen, known in (("scenario", scenarios, SCENARIOS), ("law", laws, LAWS)):
        if unknown := sorted({*chosen} - {*known}):
            raise UsageError(f"{what} {unknown[0]} is not part of the article's evaluation: {', '.join(known)}")
    pairs = [(scenario, law) for scenario in SCENARIOS for law in (*ARTICLE_LAWS, *BASELINES)]
    runs = []
    for scenario, law in (*pairs, (SCENARIOS[0], PRINTED_DTSM)):
        if scenario in (scenarios or SCENARIOS) and law in (laws or LAWS):
            of_article = [str(article_parameters(law))] if law in (*ARTICLE_LAWS, PRINTED_DTSM) else []
            name = "dtsm" if law == PRINTED_DTSM else law
            experiment = make_experiment(scenario, name, duration, [*of_article, *params], overrides)
            recorded_parameters(experiment, "lockstep")
            runs.append(Planned(scenario, law, experiment))
    if not runs:
        raise UsageError(f"{PRINTED_DTSM} is part of the evaluation only in {SCENARIOS[0]}")
    return runs


def make_runs(
    planned: Sequence[Planned], folder: Path, workers: int, resume: bool, progress: Progress
) -> dict[str, str]:
    """Make the runs with the nodes in lockstep, several in parallel, each in its own ROS domain and processes.

    Args:
        planned: the runs.
        folder: parent of the runs' folders, which are named after their keys.
        workers: number of parallel runs.
        resume: keep existing runs with the same parameters.
        progress: called during the runs.

    Returns:
        Reasons of failed runs, by key.
    """
    waiting = [p for p in planned if not (resume and is_done(p, folder / p.key))]
    for done in planned:
        if done not in waiting:
            progress(done.key, done.experiment.duration)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    running: dict[str, tuple[ForkServerProcess, Synchronized[float], Any]] = {}
    failed: dict[str, str] = {}
    try:
        while waiting or running:
            # A process that is not in the list would outlive an interrupt, without its clock; and an interrupt while
            # one is deleted would be lost, as any exception there is.
            with uninterrupted():
                while waiting and len(running) < workers:
                    chosen = waiting.pop(0)
                    clock, errors = context.Value("d", 0.0), context.SimpleQueue()
                    process = context.Process(
                        target=_make_run, args=(chosen.experiment, folder / chosen.key, clock, errors), name=chosen.key
                    )
                    process.start()
                    running[chosen.key] = process, clock, errors
                for key, (process, clock, errors) in list(running.items()):
                    progress(key, clock.value)
                    if process.exitcode is None:
                        continue
                    if process.exitcode != 0:
                        failed[key] = "the process died" if errors.empty() else str(errors.get())
                    del running[key], process, clock, errors
            time.sleep(_POLL)
    finally:
        with uninterrupted():
            for process, _, _ in running.values():
                process.terminate()
            for process, _, _ in running.values():
                process.join()
    return failed


def is_done(planned: Planned, folder: Path) -> bool:
    """Whether the folder contains this run, complete and with the same parameters."""
    if not (folder / "metrics.json").is_file():
        return False
    try:
        return all(
            (folder / "params" / f"{node}.yaml").read_text(encoding="utf-8") == ros_parameters(node, values)
            for node, values in node_parameters(planned.experiment, "lockstep").items()
        )
    except OSError:
        return False


def load(planned: Sequence[Planned], folder: Path, failed: Mapping[str, str]) -> dict[tuple[str, str], Any]:
    """Recordings and metrics by (scenario, law), from the bags; for a failed run, the reason."""
    runs: dict[tuple[str, str], Any] = {}
    for p in planned:
        if p.key in failed:
            runs[p.scenario, p.law] = failed[p.key]
            continue
        recording = read_recording(folder / p.key / "bag")
        runs[p.scenario, p.law] = recording, recording.metrics()
    return runs


def write_results(runs: Mapping[tuple[str, str], Any], comparisons: Sequence[Comparison], file: Path) -> None:
    """Write results.json: the metrics of every run, and the comparison with the article."""
    content = {
        "runs": {
            f"{scenario}-{law}": {"failed": run} if isinstance(run, str) else run[1]
            for (scenario, law), run in runs.items()
        },
        "comparison": [as_json(comparison) for comparison in comparisons],
    }
    file.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _make_run(experiment: Experiment, folder: Path, clock: "Synchronized[float]", errors: Any) -> None:
    """Make one run, in a separate process."""
    signal.signal(signal.SIGTERM, _interrupt)

    def show(seconds: float) -> None:
        clock.value = seconds

    try:
        with result_folder(folder) as unfinished:
            bag = run(experiment, "lockstep", unfinished, show)
            write_metrics(read_recording(bag).metrics(), unfinished / "metrics.json")
    except KeyboardInterrupt:
        os._exit(130)
    except (RunError, UsageError, RecordingError) as error:
        errors.put(str(error))
        os._exit(1)


def _interrupt(_signal: int, _frame: object) -> None:
    raise KeyboardInterrupt
