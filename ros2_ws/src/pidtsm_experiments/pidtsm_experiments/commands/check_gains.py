"""``./pidtsm check-gains``: the conditions that theory puts on gains, and its bounds along a run."""

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import Experiment
from pidtsm_core.experiment.definition import MEASUREMENT
from pidtsm_experiments.commands.options import CONSOLE, add_experiment_arguments, experiment_of, read
from pidtsm_experiments.runs.origin import MadeOf
from pidtsm_experiments.runs.results import result_folder
from pidtsm_experiments.runs.saved import read_parameters

if TYPE_CHECKING:
    from pidtsm_studies.theory.check import GainCheck

_EPILOG = """Each condition has its equation in the article (eq.), or author and year of another source. A set holds it,
violates it, or has something that the proof does not cover, such as a bounded gain: it may well work, but the theorem
does not promise it. The bounds are evaluated along a rollout of the experiment, or along --run; docs/theory.md explains
them.

examples:
  ./pidtsm check-gains
  ./pidtsm check-gains --robot panda --params practical
  ./pidtsm check-gains --set controller.law.kp=0 --set controller.law.ki=0
  ./pidtsm check-gains --scenario case2 --set controller.estimator.name=exact --out results/check-gains

exit codes: 0 no condition is violated, 1 one is, 2 bad usage or input
"""
_TOGETHER = 4
"""Joints beside each other in 80 columns."""
_OF_EXPERIMENT = (
    "scenario", "robot", "joints", "lock", "effort", "payload", "xacro", "save", "hardware", "engine", "law",
    "duration", "params", "set",
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_experiment_arguments(parser)
    parser.epilog = _EPILOG
    parser.add_argument(
        "--run",
        type=Path,
        metavar="RUN",
        help="result folder of run or rollout --out, whose gains are checked and along which the bounds are evaluated "
        "(default: a rollout of the experiment)",
    )
    parser.add_argument("--json", action="store_true", help="print everything as one JSON object")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="result folder for check.json and figures (default: only print)"
    )


def execute(options: argparse.Namespace) -> int:
    check, made_of = _of_run(options) if options.run else _of_experiment(options)
    text = json.dumps(check.to_json(), allow_nan=False)
    if options.json:
        print(text)
    else:
        _show(check)
    if options.out:
        _write(check, text, options.out, made_of)
    return 1 if check.violated else 0


def _of_experiment(options: argparse.Namespace) -> tuple["GainCheck", MadeOf]:
    from pidtsm_studies.theory.check import check_gains

    experiment = experiment_of(options)
    return check_gains(experiment), MadeOf(parameters=experiment.values)


def _of_run(options: argparse.Namespace) -> tuple["GainCheck", MadeOf]:
    """The check of a run with its own gains.

    Raises:
        UsageError: an option contradicts the run, its parameters are missing, or it has no ground truth.
    """
    from pidtsm_studies.theory.check import checked

    if given := [name for name in _OF_EXPERIMENT if getattr(options, name, None)]:
        raise UsageError(f"--run has its own parameters; omit --{given[0]}")
    recording = read(options.run)
    settings = read_parameters(options.run)
    if "controller" not in settings:
        raise UsageError(f"{options.run} has no parameters of its controller; give the result folder of the run")
    only = {"controller": settings["controller"]}
    experiment = Experiment(str(options.run), "", 1.0, only, purpose=MEASUREMENT._replace(nodes=("controller",)))
    return checked(experiment.values["controller"], recording), MadeOf(runs=(options.run,))


def _write(check: "GainCheck", text: str, out: Path, made_of: MadeOf) -> None:
    # Slow to import.
    from pidtsm_studies.theory.figures import write_theory_figures

    with result_folder(out, made_of) as folder:
        (folder / "check.json").write_text(text + "\n", encoding="utf-8")
        drawn = check.recording is not None and check.bounds is not None
        if check.recording is not None and check.bounds is not None:
            write_theory_figures(check.recording, check.bounds, folder / "figures")
    CONSOLE.print(f"{out}: check.json{' figures/' if drawn else ''}", highlight=False)


def _show(check: "GainCheck") -> None:
    from pidtsm_studies.theory.tables import CONDITIONS, condition_rows, lyapunov_sentence, sentences

    console = Console()
    console.print(_table(f"conditions of {check.law}", CONDITIONS, condition_rows(check), len(CONDITIONS)))
    if check.bounds is not None:
        for table in _bound_tables(check):
            console.print(table)
        console.print(lyapunov_sentence(check.bounds), highlight=False, markup=False, soft_wrap=True)
    elif check.reason:
        console.print(check.reason, highlight=False, markup=False, soft_wrap=True)
    for text in sentences(check):
        style = "bold red" if text.startswith("violated") else ""
        console.print(text, style=style, highlight=False, markup=False, soft_wrap=True)
    if not check.violated:
        console.print("no condition is violated", highlight=False)


def _bound_tables(check: "GainCheck") -> Iterator[Table]:
    """A table for each few joints."""
    from pidtsm_studies.theory.tables import bound_rows

    assert check.bounds is not None
    rows = bound_rows(check.bounds)
    for start in range(0, len(check.joints), _TOGETHER):
        joints = slice(start, start + _TOGETHER)
        columns = ("along the run", *check.joints[joints])
        yield _table("", columns, [[name, *values[joints]] for name, *values in rows], 1)


def _table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], texts: int) -> Table:
    """A table whose first columns are texts and whose others are numbers."""
    table = Table(title=title or None, title_style="bold", box=box.SIMPLE_HEAD, collapse_padding=True, pad_edge=False)
    for i, column in enumerate(columns):
        table.add_column(escape(column), justify="left" if i < texts else "right", overflow="fold")
    for row in rows:
        table.add_row(*map(escape, row))
    return table
