"""``./pidtsm report``: metrics, figures and report of a result folder, made anew from its recording."""

import argparse
from pathlib import Path

from pidtsm_core.errors import UsageError
from pidtsm_experiments.commands.options import CONSOLE, read
from pidtsm_experiments.runs.outputs import write_outputs
from pidtsm_experiments.runs.results import renewed
from pidtsm_experiments.runs.saved import is_result_folder


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="result folder of run, demo or rollout --out")


def execute(options: argparse.Namespace) -> int:
    if not is_result_folder(options.folder):
        raise UsageError(f"{options.folder} is not a result folder: it has neither bag/ nor recording.npz")
    with renewed(options.folder) as folder, CONSOLE.status("analysing, drawing, writing the report"):
        write_outputs(read(options.folder), folder)
    CONSOLE.print(f"{options.folder}: report.html metrics.json figures/", highlight=False)
    return 0
