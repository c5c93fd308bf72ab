"""``./pidtsm rollout``: the closed loop without ROS."""

import argparse

import numpy as np

from pidtsm_core.parameters import ParameterError
from pidtsm_core.rollout import SCHEMAS, DivergedError, Rollout, rollout
from pidtsm_experiments.analysis import summarize
from pidtsm_experiments.commands.options import add_experiment_arguments, experiment_of, show_metrics
from pidtsm_experiments.errors import RunError, UsageError
from pidtsm_experiments.experiment import Experiment
from pidtsm_experiments.recording import Recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_experiment_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print the metrics as one JSON object, and nothing else")


def execute(options: argparse.Namespace) -> int:
    experiment = experiment_of(options).without_node_parameters()
    experiment.resolved(SCHEMAS)
    try:
        result = rollout(experiment.settings, experiment.duration)
    except ParameterError as error:
        raise UsageError(str(error)) from None
    except DivergedError as error:
        raise RunError(str(error)) from None
    show_metrics(summarize(_recording(result, experiment)), options.json)
    return 0


def _recording(result: Rollout, experiment: Experiment) -> Recording:
    """The rollout as if it had been recorded."""
    return Recording(
        joints=result.joints,
        time=result.time,
        stamps_ns=np.round(result.time * 1e9).astype(np.int64),
        position=result.position,
        velocity=result.velocity,
        effort=result.effort,
        reference=result.reference,
        signals=result.signals,
        compute_time=np.empty(0),
        scenario=experiment.scenario,
        law=experiment.law,
        clock=None,
        event_time=experiment.event_time,
    )
