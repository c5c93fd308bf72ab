"""``./pidtsm run``: an experiment with the real nodes."""

import argparse
from dataclasses import replace
from pathlib import Path

from pidtsm_core import __version__
from pidtsm_core.experiment import Experiment
from pidtsm_core.recording import Recording
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
from pidtsm_studies.replay import check_video, check_viewer, show, write_video


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
    parser.add_argument("--video", action="store_true", help="also render the run to video.mp4 and still.png")
    parser.add_argument("--viewer", action="store_true", help="play the run in MuJoCo's viewer when it has ended")


def execute(options: argparse.Namespace) -> int:
    if options.video:
        check_video()
    if options.viewer:
        check_viewer()
    experiment = experiment_of(options)
    out = options.out or Path("results", f"{experiment.scenario}-{experiment.law}")
    recording = run_and_report(experiment, options.clock, out, options.composed, options.video)
    if options.viewer:
        show(recording, recorded_parameters(experiment, options.clock)["simulator"])
    require_followed(recording.metrics())
    return 0


def run_and_report(
    experiment: Experiment, clock: str, out: Path, composed: bool = False, video: bool = False
) -> Recording:
    """Run an experiment, analyse it, draw the figures, and print where the results are; returns the run.

    Raises:
        UsageError: see `runner.run` and `result_folder`.
        RunError: the run failed.
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
            found = read_recording(bag)
        except RecordingError as error:
            raise RunError(str(error)) from None
        recording = replace(found, parameters=parameters, version=__version__, recorded_commit=None)
        metrics = write_outputs(recording, folder)
        if video:
            bar.update(task, description=f"{title}: rendering")
            write_video(recording, parameters["simulator"], folder)
    show_metrics(metrics, as_json=False)
    files = "report.html metrics.json figures/ bag/ params/ log/"
    CONSOLE.print(f"{out}: {files}{' video.mp4 still.png' if video else ''}", highlight=False)
    return recording
