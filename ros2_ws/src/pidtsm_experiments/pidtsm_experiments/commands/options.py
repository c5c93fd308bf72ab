"""Options that several commands share."""

import argparse
import json
import math
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from pidtsm_core.control import LAW_NAME, Controller
from pidtsm_core.experiment import Experiment, make_experiment, scenario_names
from pidtsm_core.laws import LAWS
from pidtsm_core.outcome import why_not_followed
from pidtsm_core.parameters import Value
from pidtsm_experiments.commands.table import print_metrics
from pidtsm_experiments.errors import RunError

CONSOLE = Console(stderr=True)
"""For progress and messages; results go to standard output."""


def add_experiment_arguments(parser: argparse.ArgumentParser) -> None:
    """What says which experiment is meant."""
    parser.description = f"{parser.description}\n\nThe later wins: scenario, --params, --law, --set."
    parser.add_argument(
        "--scenario",
        default="case1",
        metavar="NAME|FILE",
        help=f"one of {', '.join(scenario_names())}, or a scenario file (default: case1)",
    )
    parser.add_argument("--law", metavar="NAME", help=f"one of {', '.join(LAWS.names)} (default: {LAW_NAME.default})")
    parser.add_argument("--duration", type=seconds, metavar="S", help="seconds, instead of the scenario's")
    parser.add_argument(
        "--params",
        action="append",
        default=[],
        metavar="article|practical|FILE",
        help="the article's Table 1, the set for real sensors and drives, or a ROS parameter file for any of the "
        "nodes; wins over the scenario; may be given again, the last one wins",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NODE.PARAM=VALUE",
        help="one parameter, such as controller.law.upsilon=0.01; wins over all others; may be given again",
    )


def experiment_of(options: argparse.Namespace) -> Experiment:
    """The experiment that the options describe."""
    return make_experiment(options.scenario, options.law, options.duration, options.params, options.set)


def seconds(text: str) -> float:
    """A positive, finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number of seconds")
    return value


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A progress bar on standard error, gone when the block ends."""
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=CONSOLE, transient=True) as bar:
        yield bar


def show_metrics(metrics: Mapping[str, Any], as_json: bool) -> None:
    """Print metrics on standard output, as a table or as one JSON object."""
    if as_json:
        print(json.dumps(metrics, allow_nan=False))
        sys.stdout.flush()
    else:
        print_metrics(metrics)


def warn(controller: Mapping[str, Value]) -> None:
    """Say on standard error what is wrong with parameters that are allowed.

    Args:
        controller: every parameter of the controller.
    """
    for text in Controller(controller).warnings():
        print(f"pidtsm: warning: {text}", file=sys.stderr)


def require_followed(metrics: Mapping[str, Any]) -> None:
    """End the command after a run that did not come to a good end.

    Raises:
        RunError: the controller does not follow at the end, and why.
    """
    if reason := why_not_followed(metrics):
        raise RunError(reason)
