"""``./pidtsm robustness``: how much imperfection each controller tolerates, from many rollouts."""

import argparse
import json
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from pidtsm_experiments.commands.options import CONSOLE, add_parameter_arguments, progress_bar
from pidtsm_experiments.runs.results import result_folder
from pidtsm_studies.robustness.contenders import choose
from pidtsm_studies.robustness.figures import write_robustness_figures
from pidtsm_studies.robustness.imperfections import CASE, IMPERFECTIONS
from pidtsm_studies.robustness.report import write_robustness_report
from pidtsm_studies.robustness.requirements import REQUIREMENTS
from pidtsm_studies.robustness.results import FULL, QUICK, Robustness, as_json
from pidtsm_studies.robustness.study import measure
from pidtsm_studies.robustness.wording import measured_text, tolerance_text, verdict_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--out", type=Path, default=Path("results", "robustness"), metavar="DIR", help="default: results/robustness"
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help=f"{QUICK.values} values and {QUICK.seeds} seeds, only to check that everything runs",
    )
    parser.add_argument(
        "--law", action="append", default=[], metavar="NAME", help="only controllers with this law; can be repeated"
    )
    parser.add_argument(
        "--scenario", default=CASE, metavar="NAME|FILE", help="of the single imperfections (default: %(default)s)"
    )
    add_parameter_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print only the results, as one JSON object")


def execute(options: argparse.Namespace) -> int:
    contenders = choose(options.law, options.params, options.set)
    for contender in contenders:
        contender.check(options.scenario)
    with result_folder(options.out) as folder:
        with progress_bar() as bar:
            task = bar.add_task("rollouts", total=None)
            robustness = measure(
                QUICK if options.quick else FULL,
                lambda done, total: bar.update(task, completed=done, total=total),
                contenders,
                options.scenario,
            )
        with CONSOLE.status("drawing, writing the report"):
            text = json.dumps(as_json(robustness), allow_nan=False)
            (folder / "robustness.json").write_text(text + "\n", encoding="utf-8")
            write_robustness_figures(robustness, folder / "figures")
            write_robustness_report(folder / "report.html", robustness)
    if options.json:
        print(text)
        return 0
    console = Console()
    console.print(_requirements(robustness))
    console.print(_tolerance(robustness))
    CONSOLE.print(f"{options.out}: report.html robustness.json figures/", highlight=False)
    return 0


def _requirements(robustness: Robustness) -> Table:
    effort = robustness.effort
    title = f"{verdict_text(robustness)} of imperfect hardware ({effort.duration:g} s, {effort.seeds} seeds)"
    table = _table(title, "hardware", "set", "RMSE", "ECI", "error (rad)", "variation (N m)", "success")
    for requirement, by_contender in zip(REQUIREMENTS, robustness.achievements, strict=True):
        for name, each in by_contender.items():
            kept = each.kept(requirement)
            cells = (
                f"{measured_text(value)}{'' if kept[quantity] else ' [bold red]✗[/]'}"
                for quantity, value in each.values.items()
            )
            head = requirement.label if name == next(iter(by_contender)) else ""
            table.add_row(head, name, *cells, f"{100.0 * each.success:.0f} %")
    return table


def _tolerance(robustness: Robustness) -> Table:
    names = (each.heading for each in robustness.contenders)
    table = _table("tolerance: up to this value every run succeeded", "", *names)
    for each in IMPERFECTIONS:
        head = f"{each.name}\n[dim]{each.unit}[/]" if each.unit else each.name
        table.add_row(head, *(tolerance_text(robustness, each, contender.name) for contender in robustness.contenders))
    return table


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_style="bold", box=box.SIMPLE_HEAD, padding=0, show_edge=False)
    for column in columns:
        table.add_column(column, overflow="fold")
    return table
