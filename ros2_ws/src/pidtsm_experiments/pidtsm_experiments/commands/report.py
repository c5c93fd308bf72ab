"""``./pidtsm report``: metrics, figures and report of a result folder, made anew from its recording, or of a bag."""

import argparse
from pathlib import Path

from pidtsm_core.errors import UsageError
from pidtsm_experiments.commands.options import CONSOLE, read
from pidtsm_experiments.runs.origin import MadeOf
from pidtsm_experiments.runs.outputs import write_outputs
from pidtsm_experiments.runs.results import renewed, result_folder
from pidtsm_experiments.runs.saved import is_result_folder


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "folder", type=Path, metavar="DIR", help="result folder of run, demo or rollout --out, or a bag (with --out)"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the report, instead of the result folder")


def execute(options: argparse.Namespace) -> int:
    if options.out is None and not is_result_folder(options.folder):
        raise UsageError(
            f"{options.folder} is not a result folder: it has neither bag/ nor recording.npz; if it is a bag, name the "
            "folder of its report with --out"
        )
    made = ("report.html", "metrics.json", "figures")
    made_of = MadeOf(runs=(options.folder,))
    place = renewed(options.folder, *made) if options.out is None else result_folder(options.out, made_of)
    with place as folder, CONSOLE.status("analysing, drawing, writing the report"):
        write_outputs(read(options.folder), folder, options.folder)
    CONSOLE.print(f"{options.out or options.folder}: report.html metrics.json figures/", highlight=False)
    return 0
