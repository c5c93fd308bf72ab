"""``./pidtsm score``: how much imperfection a controller tolerates on an arm."""

import argparse
import json
from dataclasses import replace
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from pidtsm_core.control import LAW_NAME
from pidtsm_core.experiment import DEFAULT_ROBOT
from pidtsm_core.laws import LAWS
from pidtsm_core.rollouts.closed_loop import SCHEMAS
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm
from pidtsm_experiments.commands.options import (
    CONSOLE,
    add_hardware_argument,
    add_parameter_arguments,
    progress_bar,
    say_gains,
)
from pidtsm_experiments.runs.origin import MadeOf
from pidtsm_experiments.runs.results import result_folder
from pidtsm_studies.score.criteria import FULL, QUICK
from pidtsm_studies.score.measure import Contender, measure
from pidtsm_studies.score.page import write_score_page
from pidtsm_studies.score.results import FILE, Entry, as_json
from pidtsm_studies.score.tasks import Task, find_task
from pidtsm_studies.score.wording import COLUMNS, cells, failure_text, share_text
from pidtsm_studies.tuning.definitions import PARAMETERS

SCORES = Path("results", "score")
"""Default folder of all scores."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm_arguments(parser)
    add_hardware_argument(parser)
    parser.add_argument("--law", metavar="NAME", help=f"one of {', '.join(LAWS.names)} (default: {LAW_NAME.default})")
    add_parameter_arguments(parser)
    parser.add_argument("--name", default="", help="of the controller in tables (default: law and parameter sets)")
    parser.add_argument(
        "--quick",
        action="store_true",
        help=f"{QUICK.values} values and {QUICK.repeats} seed, only to check that everything runs",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"default: {SCORES}/ROBOT/NAME")
    parser.add_argument("--json", action="store_true", help="print only the results, as one JSON object")


def execute(options: argparse.Namespace) -> int:
    task = find_task(read_arm(options) or DEFAULT_ROBOT, options.hardware)
    contender = Contender(options.law, tuple(options.params), tuple(options.set), options.name)
    name = name_of(task, contender)
    introduce(options)
    if options.hardware and not options.params:
        say_gains(options.hardware)
    of_arm = SCORES / "-".join(filter(None, [Path(task.robot).stem, options.hardware]))
    out = options.out or of_arm / name.replace("/", "-").replace(" ", "-")
    with result_folder(out, made_of(task, contender)) as folder:
        with progress_bar() as bar:
            bars = bar.add_task("rollouts", total=None)
            extent = QUICK if options.quick else FULL
            entry = measure(
                task,
                replace(contender, name=name),
                extent,
                lambda done, total: bar.update(bars, completed=done, total=total),
            )
        text = json.dumps(as_json(entry), allow_nan=False)
        (folder / FILE).write_text(text + "\n", encoding="utf-8")
        write_score_page(folder / "report.html", "Score", [entry])
    if options.json:
        print(text)
        return 0
    console = Console()
    for table in _tables(entry):
        console.print(table)
    CONSOLE.print(f"{out}: report.html {FILE}", highlight=False)
    return 0


def name_of(task: Task, contender: Contender) -> str:
    """Name of a controller in tables: as given, or that of its law and its parameter sets.

    Raises:
        UsageError: the controller is refused, see `Task.experiment`.
    """
    law = task.experiment(contender.law, contender.params, contender.overrides).law
    return contender.name or " ".join([law, *map(_set_name, contender.params)])


def _set_name(params: str) -> str:
    """Name of a parameter set: that of its file, or of the folder of a tuning."""
    file = Path(params)
    return file.absolute().parent.name if file.name == PARAMETERS else file.stem


def made_of(task: Task, contender: Contender) -> MadeOf:
    """The parameters of the nominal run of a controller; its criteria change some, see score.json."""
    experiment = task.experiment(contender.law, contender.params, contender.overrides)
    return MadeOf(parameters=experiment.resolved(SCHEMAS))


def _tables(entry: Entry) -> tuple[Table, Table]:
    shares = Table(title=f"successful runs, {entry.runs} in all", title_style="bold", box=box.SIMPLE_HEAD)
    for column in ("criterion", "share", "interval", "fails first"):
        shares.add_column(column)
    for each in entry.outcomes:
        low, high = each.interval
        interval = f"{100.0 * low:.0f} to {100.0 * high:.0f} %" if each.criterion.random else ""
        shares.add_row(each.criterion.label, share_text(each), interval, failure_text(each))
    summary = Table(title=f"on {entry.task.robot}", title_style="bold", box=box.SIMPLE_HEAD, show_header=False)
    for row in zip(COLUMNS, cells(entry), strict=True):
        summary.add_row(*row)
    return shares, summary
