"""``./pidtsm rollout``: the closed loop without ROS."""

import argparse
from pathlib import Path
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import Experiment
from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import DivergedError, rollout
from pidtsm_experiments.commands.options import (
    CONSOLE,
    add_experiment_arguments,
    experiment_of,
    require_followed,
    show_metrics,
    warn,
)
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.runs.results import result_folder


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_experiment_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print only the metrics, as one JSON object")
    parser.add_argument("--out", type=Path, metavar="DIR", help="result folder, as of run (default: only print)")
    parser.add_argument("--bag", action="store_true", help="leave a bag in the result folder, instead of recording.npz")


def execute(options: argparse.Namespace) -> int:
    experiment = experiment_of(options)
    warn(experiment.values["controller"])
    out: Path | None = options.out
    if options.bag and not out:
        raise UsageError("--bag needs --out, the folder of the bag")
    metrics = kept(experiment, out, options.bag) if out else _recording(experiment).metrics()
    show_metrics(metrics, options.json)
    require_followed(metrics)
    return 0


def _recording(experiment: Experiment) -> Recording:
    """Simulate an experiment.

    Raises:
        UsageError: a setting is refused.
        RunError: a value of the loop is no longer finite.
    """
    try:
        return rollout(experiment)
    except DivergedError as error:
        raise RunError(str(error)) from None


def kept(experiment: Experiment, out: Path, bag: bool = False) -> dict[str, Any]:
    """Simulate an experiment and leave its results in a folder, with a bag or a smaller file, and say so on standard
    error; returns the metrics.

    Raises:
        UsageError: a setting is refused; see also `result_folder`.
        RunError: a value of the loop is no longer finite.
    """
    # Libraries for drawing and bags take longer to import than a rollout takes.
    from pidtsm_experiments.bags.rollout_bag import write_rollout_bag
    from pidtsm_experiments.runs.outputs import write_outputs
    from pidtsm_experiments.runs.saved import RECORDING, save_recording, write_parameters

    with result_folder(out) as folder:
        write_parameters(experiment.values, folder)
        recording = _recording(experiment)
        if bag:
            write_rollout_bag(recording, experiment.values["trajectory"], folder / "bag")
        else:
            save_recording(recording, folder / RECORDING)
        metrics = write_outputs(recording, folder)
    files = f"report.html metrics.json figures/ params/ {'bag/' if bag else RECORDING}"
    CONSOLE.print(f"{out}: {files}", highlight=False)
    return metrics
