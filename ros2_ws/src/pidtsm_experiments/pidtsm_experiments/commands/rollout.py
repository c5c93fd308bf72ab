"""``./pidtsm rollout``: the closed loop without ROS."""

import argparse

from pidtsm_core.errors import UsageError
from pidtsm_core.parameters import ParameterError
from pidtsm_core.recording import Recording
from pidtsm_core.rollout import SCHEMAS, DivergedError, rollout
from pidtsm_core.summary import summarize
from pidtsm_experiments.commands.options import (
    add_experiment_arguments,
    experiment_of,
    require_followed,
    show_metrics,
    warn,
)
from pidtsm_experiments.errors import RunError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_experiment_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print only the metrics, as one JSON object")


def execute(options: argparse.Namespace) -> int:
    experiment = experiment_of(options).without_node_parameters()
    warn(experiment.resolved(SCHEMAS)["controller"])
    try:
        result = rollout(experiment.settings, experiment.duration)
    except ParameterError as error:
        raise UsageError(str(error)) from None
    except DivergedError as error:
        raise RunError(str(error)) from None
    recording = Recording.of_rollout(result, experiment.scenario, experiment.law, experiment.event_time)
    metrics = summarize(recording)
    show_metrics(metrics, options.json)
    require_followed(metrics)
    return 0
