"""``./pidtsm run``: an experiment with the real nodes."""

import argparse
from pathlib import Path

from pidtsm_core.experiment import Experiment
from pidtsm_experiments.bags.errors import RecordingError
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.commands.options import (
    CONSOLE,
    add_experiment_arguments,
    experiment_of,
    progress_bar,
    require_followed,
    show_metrics,
    warn,
)
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.runs.outputs import write_outputs
from pidtsm_experiments.runs.results import result_folder
from pidtsm_experiments.runs.runner import recorded_parameters, run


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_experiment_arguments(parser)
    parser.add_argument(
        "--clock",
        choices=("lockstep", "realtime"),
        default="lockstep",
        help="lockstep: deterministic, as fast as possible; realtime: in real time (default: lockstep)",
    )
    parser.add_argument(
        "--composed", action="store_true", help="run all nodes but the recorder in one process: lowest latency"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="result folder (default: results/SCENARIO-LAW)")


def execute(options: argparse.Namespace) -> int:
    experiment = experiment_of(options)
    out = options.out or Path("results", f"{experiment.scenario}-{experiment.law}")
    run_and_report(experiment, options.clock, out, options.composed)
    return 0


def run_and_report(experiment: Experiment, clock: str, out: Path, composed: bool = False) -> None:
    """Run an experiment, analyse it, draw the figures, and print where the results are.

    Raises:
        UsageError: see `runner.run` and `result_folder`.
        RunError: the run failed, or, with complete results, the controller does not follow at the end.
    """
    parameters = recorded_parameters(experiment, clock)  # Reject invalid parameters before anything starts.
    warn(parameters["controller"])
    title = f"{experiment.scenario}, {experiment.law}, {clock}"
    with result_folder(out) as folder, progress_bar() as bar:
        task = bar.add_task(f"{title}: starting the nodes", total=experiment.duration)

        def show(time: float) -> None:
            bar.update(task, completed=time, description=title)

        def announce(place: str) -> None:
            bar.console.print(f"{title}: {place}", highlight=False)

        bag = run(experiment, clock, folder, show, composed, announce)
        bar.update(task, completed=experiment.duration, description=f"{title}: analysing")
        try:
            recording = read_recording(bag)
        except RecordingError as error:
            raise RunError(str(error)) from None
        metrics = write_outputs(recording, folder)
    show_metrics(metrics, as_json=False)
    CONSOLE.print(f"{out}: report.html metrics.json figures/ bag/ params/ log/", highlight=False)
    require_followed(metrics)
