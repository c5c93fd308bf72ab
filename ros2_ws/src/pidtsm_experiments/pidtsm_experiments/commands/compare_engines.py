"""``./pidtsm compare-engines``: the same experiment on both engines of the simulated arm."""

import argparse
import json
from pathlib import Path

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pidtsm_core.rollouts.closed_loop import DivergedError
from pidtsm_experiments.commands.options import CONSOLE, add_experiment_arguments, experiment_of
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.runs.origin import MadeOf
from pidtsm_experiments.runs.results import result_folder
from pidtsm_studies.engines import (
    COMPARED,
    EngineComparison,
    as_json,
    compare_engines,
    write_engine_figures,
    write_engine_page,
)
from pidtsm_studies.reports.labels import value_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_experiment_arguments(parser, engine=False)
    parser.add_argument(
        "--out", type=Path, default=Path("results", "engines"), metavar="DIR", help="default: results/engines"
    )
    parser.add_argument("--json", action="store_true", help="print only the comparison, as one JSON object")


def execute(options: argparse.Namespace) -> int:
    experiment = experiment_of(options)
    with result_folder(options.out, MadeOf(parameters=experiment.values)) as folder:
        try:
            comparison = compare_engines(experiment)
        except DivergedError as error:
            raise RunError(str(error)) from None
        text = json.dumps(as_json(comparison), allow_nan=False)
        (folder / "engines.json").write_text(text + "\n", encoding="utf-8")
        write_engine_figures(comparison, folder / "figures")
        write_engine_page(comparison, folder / "report.html", experiment.settings["simulator"])
    if options.json:
        print(text)
        return 0
    Console().print(_table(comparison))
    CONSOLE.print(f"{options.out}: report.html engines.json figures/", highlight=False)
    return 0


def _table(comparison: EngineComparison) -> Table:
    recording, metrics = next(iter(comparison.runs.values())), next(iter(comparison.metrics.values()))
    title = f"{recording.scenario}, {recording.law}, {recording.duration:g} s: MuJoCo and the equations of the model"
    table = Table(title=escape(title), title_style="bold", box=box.SIMPLE_HEAD)
    table.add_column("joint", overflow="fold")
    for metric in COMPARED:
        table.add_column(metric.heading, justify="right")
        table.add_column("MuJoCo", justify="right")
    table.add_column("largest |Δq|", justify="right")
    for j, joint in enumerate(recording.joints):
        cells = []
        for metric in COMPARED:
            cells += [value_text(metrics[metric.key][j]), f"{100.0 * comparison.relative(metric.key)[j]:+.1g} %"]
        table.add_row(escape(joint), *cells, f"{comparison.difference[:, j].max():.1e}")
    return table
