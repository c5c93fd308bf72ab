"""``./pidtsm demo``: Case 1, or the default motion of another arm, with the proposed law and the real nodes."""

import argparse
from pathlib import Path

from pidtsm_core.experiment import make_experiment
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm
from pidtsm_experiments.commands.options import (
    add_engine_argument,
    engine_overrides,
    require_followed,
)
from pidtsm_experiments.commands.run import run_and_report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm_arguments(parser)
    add_engine_argument(parser)
    parser.add_argument(
        "--out", type=Path, default=Path("results", "demo"), metavar="DIR", help="default: results/demo"
    )


def execute(options: argparse.Namespace) -> int:
    experiment = make_experiment(None, overrides=engine_overrides(options.engine), robot=read_arm(options))
    introduce(options)
    require_followed(run_and_report(experiment, "lockstep", options.out).metrics())
    return 0
