"""``./pidtsm leaderboard``: all scores in one page and one document."""

import argparse
from pathlib import Path

from pidtsm_experiments.commands.options import CONSOLE
from pidtsm_experiments.commands.score import SCORES
from pidtsm_experiments.runs.origin import MadeOf
from pidtsm_experiments.runs.results import result_folder
from pidtsm_studies.score.leaderboard import read_entries, write_leaderboard
from pidtsm_studies.score.results import FILE


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "scores",
        nargs="?",
        type=Path,
        default=SCORES,
        metavar="DIR",
        help="folder of the scores (default: %(default)s)",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("results", "leaderboard"), metavar="DIR", help="default: results/leaderboard"
    )


def execute(options: argparse.Namespace) -> int:
    entries = read_entries(options.scores)
    scores = tuple(file.parent for file in sorted(options.scores.rglob(FILE)))
    with result_folder(options.out, MadeOf(runs=scores)) as folder, CONSOLE.status("drawing, writing the page"):
        write_leaderboard(folder, entries)
    CONSOLE.print(f"{options.out}: leaderboard.html leaderboard.md images/", highlight=False)
    return 0
