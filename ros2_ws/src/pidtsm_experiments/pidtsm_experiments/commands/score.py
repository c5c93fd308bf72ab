"""``./pidtsm score``: how much imperfection a controller tolerates on an arm."""

import argparse
import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from pidtsm_core.control import LAW_NAME
from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import DEFAULT_ROBOT, Experiment
from pidtsm_core.laws import LAWS
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
from pidtsm_studies.score.criteria import QUICK, Extent, extent_of
from pidtsm_studies.score.measure import ORACLE, measure
from pidtsm_studies.score.page import write_score_page
from pidtsm_studies.score.plan import CONTROL, Contender, bad_gains
from pidtsm_studies.score.results import FILE, Entry, as_json, read_entry
from pidtsm_studies.score.tasks import BASES, IDEAL, ON_HARDWARE, Task, find_task
from pidtsm_studies.score.wording import (
    COLUMNS,
    COLUMNS_ON_HARDWARE,
    cells,
    cells_on_hardware,
    failure_text,
    share_text,
)
from pidtsm_studies.tuning.definitions import PARAMETERS

REFERENCES = (ORACLE, CONTROL.replace(" ", "_"))
"""Rows that show what a score can be at most, and what it is if the gains are bad."""
SCORES = Path("results", "score")
"""Default folder of all scores."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm_arguments(parser)
    add_hardware_argument(parser)
    parser.add_argument(
        "--base",
        choices=BASES,
        help="what every range is varied around: ideal hardware, or the arm's own class of hardware, with more "
        "criteria, several motions and the oracle as the ceiling (default: ideal; hardware with --hardware, which then "
        "chooses the class)",
    )
    parser.add_argument(
        "--reference",
        choices=REFERENCES,
        help="score the oracle, which knows and acts on the truth, or bad gains, which must fail, instead of a law",
    )
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
    base = options.base or (ON_HARDWARE if options.hardware else IDEAL)
    if base == IDEAL and options.hardware:
        raise UsageError("--base ideal has no class of hardware; omit --hardware, or choose --base hardware")
    task = find_task(read_arm(options) or DEFAULT_ROBOT, options.hardware, base)
    contender = _contender(options, task)
    nominal = task.experiment(contender.law, contender.params, contender.overrides)
    name = name_of(nominal, contender)
    introduce(options)
    if task.hardware and not options.params and not contender.oracle:
        say_gains(task.hardware)
    place = SCORES / "-".join(filter(None, [Path(task.robot).stem, task.hardware]))
    out = options.out or place / name.replace("/", "-").replace(" ", "-")
    extent = extent_of(base, options.quick)
    with result_folder(out, MadeOf(parameters=nominal.values)) as folder:
        entry = scored(task, replace(contender, name=name), extent)
        rows = [entry]
        if base == ON_HARDWARE and not contender.oracle:
            rows.append(_ceiling(task, extent, place / ORACLE / FILE))
        text = json.dumps(as_json(entry), allow_nan=False)
        (folder / FILE).write_text(text + "\n", encoding="utf-8")
        write_score_page(folder / "report.html", "Score", rows)
    if options.json:
        print(text)
        return 0
    console = Console()
    for table in _tables(entry, rows[-1] if len(rows) > 1 else None):
        console.print(table)
    CONSOLE.print(f"{out}: report.html {FILE}", highlight=False)
    return 0


def scored(task: Task, contender: Contender, extent: Extent) -> Entry:
    """Measure, and show the progress; see `measure`."""
    with progress_bar() as bar:
        bars = bar.add_task("rollouts", total=None)
        return measure(task, contender, extent, lambda done, total: bar.update(bars, completed=done, total=total))


def _contender(options: argparse.Namespace, task: Task) -> Contender:
    """The controller that the options choose.

    Raises:
        UsageError: a reference cannot have a law or gains.
    """
    if options.reference is None:
        return Contender(options.law, tuple(options.params), tuple(options.set), options.name)
    if options.law or options.params or options.set:
        raise UsageError(f"--reference {options.reference} has its own law and gains; omit --law, --params and --set")
    found = Contender(None, name=ORACLE, oracle=True) if options.reference == ORACLE else bad_gains(task)
    return replace(found, name=options.name or found.name)


def _ceiling(task: Task, extent: Extent, file: Path) -> Entry:
    """The oracle's entry: that of an earlier score if it is of the same task and extent, else a new one."""
    with suppress(UsageError):
        known = read_entry(file)
        if (known.task, known.extent) == (task, extent):
            return known
    return scored(task, Contender(None, name=ORACLE, oracle=True), extent)


def name_of(nominal: Experiment, contender: Contender) -> str:
    """Name of a controller in tables: as given, or that of its law, which the nominal run has, and its sets."""
    return contender.name or " ".join([nominal.law, *map(_set_name, contender.params)])


def _set_name(params: str) -> str:
    """Name of a parameter set: that of its file, or of the folder of a tuning."""
    file = Path(params)
    return file.absolute().parent.name if file.name == PARAMETERS else file.stem


def made_of(task: Task, contender: Contender) -> MadeOf:
    """The parameters of the nominal run of a controller; its criteria change some, see score.json."""
    experiment = task.experiment(contender.law, contender.params, contender.overrides)
    return MadeOf(parameters=experiment.values)


def _tables(entry: Entry, oracle: Entry | None) -> tuple[Table, Table]:
    shares = Table(title=f"successful runs, {entry.runs} in all", title_style="bold", box=box.SIMPLE_HEAD)
    for column in ("criterion", "share", "interval", *(["possible"] if oracle else []), "fails first"):
        shares.add_column(column)
    for i, each in enumerate(entry.outcomes):
        low, high = each.interval
        interval = f"{100.0 * low:.0f} to {100.0 * high:.0f} %" if low < high else ""
        possible = [share_text(oracle.outcomes[i])] if oracle else []
        shares.add_row(each.criterion.label, share_text(each), interval, *possible, failure_text(each))
    summary = Table(title=f"on {entry.task.robot}", title_style="bold", box=box.SIMPLE_HEAD, show_header=False)
    on_hardware = entry.task.base == ON_HARDWARE
    columns = COLUMNS_ON_HARDWARE if on_hardware else COLUMNS
    for row in zip(columns, cells_on_hardware(entry, oracle, None) if on_hardware else cells(entry), strict=True):
        summary.add_row(*row)
    return shares, summary
