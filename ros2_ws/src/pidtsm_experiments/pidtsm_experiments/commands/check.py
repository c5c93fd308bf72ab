"""``./pidtsm check``: what was understood of an arm, and what in its description looks like a mistake."""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pidtsm_core.errors import UsageError
from pidtsm_core.robots import DESCRIPTION
from pidtsm_core.robots.check import RATE, ArmCheck, Doubt, check_arm
from pidtsm_experiments.commands.arm_options import add_arm_arguments, given_arm, introduce
from pidtsm_experiments.commands.options import CONSOLE
from pidtsm_experiments.runs.files import writable_file

_EPILOG = """Each doubt names the file with the line, the joint or link, what is wrong with it, and the cure. Gravity's
share is the largest over the range of the arm; the inertia is what the motor of a joint accelerates while the others
move freely.

examples:
  ./pidtsm check panda
  ./pidtsm check my_arm.urdf --html my_arm.html
  ./pidtsm check my_arm.urdf --rate 500 --json

exit codes: 0 nothing looks like a mistake, 1 something does, 2 the arm cannot be used
"""
_FINE, _DOUBTFUL, _UNUSABLE = 0, 1, 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    add_arm_arguments(parser, positional=True, of="the check")
    parser.add_argument(
        "--rate",
        type=float,
        default=RATE,
        metavar="HZ",
        help="rate of the loop, for which friction is compared with inertia (default: %(default)g)",
    )
    parser.add_argument("--html", type=Path, metavar="FILE", help="write a page with a picture of the arm")
    parser.add_argument("--json", action="store_true", help="print everything as one JSON object")


def execute(options: argparse.Namespace) -> int:
    if not 1.0 <= options.rate <= 100_000.0:
        raise UsageError(f"--rate {options.rate:g}: must be from 1 to 100000 Hz")
    place = None if options.html is None else writable_file(options.html)
    arm = given_arm(options)
    assert arm is not None  # It is no option.
    # As typed, for messages.
    settings: dict[str, Any] = {**arm.settings(), DESCRIPTION.name: arm.description}
    check = check_arm(settings, options.rate)
    if options.json:
        print(json.dumps(check.as_json(), allow_nan=False))
    else:
        _show(check)
    if place is not None:
        # Slow to import.
        from pidtsm_studies.checks.report import write_check_report

        write_check_report(place, check, settings)
        CONSOLE.print(f"{options.html}", highlight=False)
    if check.refusal is not None:
        print(f"pidtsm: {_described(check, check.refusal)}", file=sys.stderr)
        return _UNUSABLE
    if options.save is not None:
        introduce(options)
    return _DOUBTFUL if check.doubts else _FINE


def _show(check: ArmCheck) -> None:
    """Print the tables and the doubts; plain text if the output is not a terminal."""
    from pidtsm_studies.checks.report import summary
    from pidtsm_studies.checks.tables import facts

    console = Console()
    if check.refusal is None:
        for name, text in facts(check):
            console.print(f"{name}: {text}", highlight=False, markup=False, soft_wrap=True)
        for table in _tables(check):
            console.print(table)
    for kind, doubts, style in (("doubt", check.doubts, "bold red"), ("note", check.notes, "")):
        for doubt in doubts:
            text = f"{kind}: {_described(check, doubt)}"
            console.print(text, style=style, highlight=False, markup=False, soft_wrap=True)
    console.print(summary(check), highlight=False, markup=False)


def _described(check: ArmCheck, doubt: Doubt) -> str:
    """A doubt with its place."""
    where = check.where(doubt)
    return f"{where}: {doubt}" if where else str(doubt)


def _tables(check: ArmCheck) -> Iterator[Table]:
    from pidtsm_studies.checks import tables

    yield _table("joints (rad; prismatic: m)", tables.JOINTS, tables.joint_rows(check), 4)
    title = "motors, gravity at worst, least inertia (N m, kg m²; N, kg)"
    yield _table(title, tables.LOADS, tables.load_rows(check), 1)
    if check.masses:
        title = "links: centre from the joint, z along its axis (kg m²)"
        yield _table(title, tables.LINKS, tables.link_rows(check), 2)
    if check.locked:
        yield _table("joints that do not move", tables.LOCKED, tables.locked_rows(check), len(tables.LOCKED))


def _table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], texts: int) -> Table:
    """A table whose first columns are texts and whose others are numbers."""
    table = Table(title=title, title_style="bold", box=box.SIMPLE_HEAD, collapse_padding=True, pad_edge=False)
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i < texts else "right", overflow="fold")
    for row in rows:
        table.add_row(*map(escape, row))
    return table
