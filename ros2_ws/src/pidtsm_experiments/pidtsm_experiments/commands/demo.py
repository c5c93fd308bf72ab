"""``./pidtsm demo``: Case 1 with the proposed law and the real nodes, in lockstep."""

import argparse
from pathlib import Path

from pidtsm_core.experiment import make_experiment
from pidtsm_experiments.commands.run import run_and_report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--out", type=Path, default=Path("results", "demo"), metavar="DIR", help="default: results/demo"
    )


def execute(options: argparse.Namespace) -> int:
    run_and_report(make_experiment("case1"), "lockstep", options.out)
    return 0
