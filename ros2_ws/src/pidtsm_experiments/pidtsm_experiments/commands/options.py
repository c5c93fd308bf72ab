"""Options shared by several commands."""

import argparse
import json
import math
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from pidtsm_core.control import LAW_NAME
from pidtsm_core.control.report import tight_rates
from pidtsm_core.experiment import DEFAULT_SCENARIO, PRACTICAL, Experiment, make_experiment, scenario_names
from pidtsm_core.experiment.definition import MEASUREMENT, Purpose
from pidtsm_core.experiment.hardware_classes import hardware_description, hardware_names
from pidtsm_core.laws import LAWS
from pidtsm_core.parameters import Value, names
from pidtsm_core.recording import Recording
from pidtsm_core.recording.outcome import why_not_followed
from pidtsm_core.simulation.mujoco_model import ENGINE
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm
from pidtsm_experiments.commands.table import print_metrics
from pidtsm_experiments.errors import RunError
from pidtsm_studies.theory.conditions import violations

CONSOLE = Console(stderr=True)
"""For progress and messages; results go to standard output."""


def add_experiment_arguments(parser: argparse.ArgumentParser, engine: bool = True, duration: bool = True) -> None:
    """Add the options that define the experiment.

    Args:
        parser: of the command.
        engine: whether one of them chooses the engine.
        duration: whether one of them is the duration.
    """
    parser.description = (
        f"{parser.description}\n\nPrecedence, lowest first: scenario, --robot, --hardware, --params, --law, --set."
    )
    parser.add_argument(
        "--scenario",
        metavar="NAME|FILE",
        help=f"one of {', '.join(scenario_names())}, or a scenario file (default: {DEFAULT_SCENARIO}; with --robot, "
        "every joint swings about its middle)",
    )
    add_arm_arguments(parser)
    add_hardware_argument(parser)
    if engine:
        add_engine_argument(parser)
    else:
        parser.set_defaults(engine=None)
    parser.add_argument("--law", metavar="NAME", help=f"one of {', '.join(LAWS.names)} (default: {LAW_NAME.default})")
    if duration:
        parser.add_argument(
            "--duration", type=seconds, metavar="S", help="duration in seconds (default: the scenario's)"
        )
    else:
        parser.set_defaults(duration=None)
    add_parameter_arguments(parser)


def add_parameter_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that set parameters."""
    parser.add_argument(
        "--params",
        action="append",
        default=[],
        metavar="article|practical|adaptive|tuned|FILE",
        help="the article's Table 1, the set for real sensors and drives, the same with friction found and compensated "
        "while the arm moves, one tuned for the arm and its own hardware (tuned) or its encoders (tuned_ideal, 17bit, "
        "14bit, 12bit), or a ROS parameter file for any of the nodes; overrides the scenario; can be repeated, later "
        "files override earlier ones (default: practical for an arm from a file)",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NODE.PARAM=VALUE",
        help="one parameter, such as controller.law.upsilon=0.01; overrides everything else; can be repeated",
    )


def add_hardware_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option that chooses the class of hardware."""
    classes = "; ".join(f"{name}: {hardware_description(name)}" for name in hardware_names()).replace("%", "%%")
    parser.add_argument(
        "--hardware",
        choices=hardware_names(),
        help=f"sensors, drives and gears of the simulated arm (default: those of the scenario). {classes}",
    )


def add_engine_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option that chooses what computes the motion of the arm."""
    parser.add_argument(
        "--engine",
        choices=ENGINE.choices,
        help=f"what computes the motion of the simulated arm (default: {ENGINE.default})",
    )


def engine_overrides(engine: str | None) -> list[str]:
    """The value of ``--engine`` as overrides, see `make_experiment`."""
    return [f"simulator.{ENGINE.name}={engine}"] if engine else []


def experiment_of(
    options: argparse.Namespace, purpose: Purpose = MEASUREMENT, otherwise: Experiment | None = None
) -> Experiment:
    """The experiment that the options define; an arm that is new to the user is introduced.

    Args:
        options: of `add_experiment_arguments`.
        purpose: what it is made for.
        otherwise: what is varied if no scenario is given; None: see `make_experiment`.
    """
    arm = read_arm(options)
    experiment = make_experiment(
        options.scenario or otherwise,
        options.law,
        options.duration,
        options.params,
        [*engine_overrides(options.engine), *options.set],
        robot=arm,
        hardware=options.hardware,
        purpose=purpose,
    )
    if arm is not None:
        introduce(options)
    if not options.params and not purpose.usual and PRACTICAL in experiment.files.values():
        say_gains(options.hardware)
    return experiment


def say_gains(hardware: str | None) -> None:
    """Print on standard error that the gains are those of the rule; `hardware` is the class that they suit."""
    suits = f"{hardware} hardware" if hardware else "14-bit encoders and 1 ms of delay"
    shown = f"./pidtsm gains --hardware {hardware}" if hardware else "./pidtsm gains"
    print(
        f"pidtsm: gains: by rule from the inertias of the arm, for {suits} "
        f"({shown} shows them, --params chooses others)",
        file=sys.stderr,
    )


def read(path: Path) -> Recording:
    """Read a run; see `read_run`. What is missing in an unfinished bag is printed on standard error."""
    # Slow to import, and not needed by rollouts.
    from pidtsm_experiments.bags.errors import UnfinishedBag
    from pidtsm_experiments.runs.saved import read_run

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UnfinishedBag)
        recording = read_run(path)
    for warning in caught:
        print(f"pidtsm: warning: {warning.message}", file=sys.stderr)
    return recording


def seconds(text: str) -> float:
    """Parse a positive, finite number of seconds."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number of seconds")
    return value


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A progress bar on standard error, removed at the end of the block."""
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
    """Print warnings about allowed but problematic parameters on standard error.

    Args:
        controller: every parameter of the controller.
    """
    violated = violations(controller, len(names(controller["joints"])))
    for text in (*tight_rates(controller), *violated):
        print(f"pidtsm: warning: {text}", file=sys.stderr)


def require_followed(metrics: Mapping[str, Any]) -> None:
    """Check that the controller follows at the end of a run.

    Raises:
        RunError: it does not; the message contains the reason.
    """
    if reason := why_not_followed(metrics):
        raise RunError(reason)
