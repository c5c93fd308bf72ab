"""``./pidtsm diagnose``: what is wrong with a loop, from a bag of it."""

import argparse
import json
import sys
import warnings
from pathlib import Path

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pidtsm_core.errors import UsageError
from pidtsm_core.parameters import ParameterError
from pidtsm_core.robots import DESCRIPTION, ROBOTS, Description
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm
from pidtsm_experiments.commands.options import CONSOLE
from pidtsm_experiments.runs.files import writable_file
from pidtsm_studies.diagnosis.causes import NAMES
from pidtsm_studies.diagnosis.diagnose import Diagnosis, diagnose

REPORT = Path("results", "diagnosis.html")
_NOTHING, _FOUND = 0, 1
_EPILOG = """The bag has joint states with positions and efforts; commands, references and the controller's state
show more. Without --robot, the arm is what the controller of a run believes, if the bag is in the folder
of one. docs/diagnose.md has what can be found, and how.

exit codes: 0 the run is good, 1 something was found, or the controller has stopped, 2 bad usage or input

examples:
  ./pidtsm diagnose results/demo/bag
  ./pidtsm diagnose stranger_bag --robot arm.urdf --out stranger.html
  ./pidtsm demo --blind 7 && ./pidtsm diagnose results/blind-7
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument("bag", type=Path, metavar="BAG", help="rosbag2 folder, its file, or the result folder of a run")
    add_arm_arguments(parser, of="the bag")
    parser.add_argument("--out", type=Path, metavar="FILE", default=REPORT, help="the page (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print the verdicts as one JSON object")


def execute(options: argparse.Namespace) -> int:
    # Libraries for bags and pages take long to import.
    from pidtsm_experiments.bags.errors import RecordingError, UnfinishedBag
    from pidtsm_experiments.bags.observed import read_observed
    from pidtsm_studies.blind.seal import opened
    from pidtsm_studies.diagnosis.report import sentence, write_diagnosis_report
    from pidtsm_studies.diagnosis.results import as_json

    bag = options.bag / "bag" if (options.bag / "bag").is_dir() else options.bag
    arm, robot = _arm(options, bag)
    if options.out == REPORT:
        REPORT.parent.mkdir(exist_ok=True)
    page = writable_file(options.out)
    introduce(options)
    try:
        with CONSOLE.status("diagnosing"), warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", UnfinishedBag)
            observed, source = read_observed(bag)
            found = diagnose(observed, arm, robot)
    except RecordingError as error:
        raise UsageError(str(error)) from None
    for warning in caught:
        if warning.category is UnfinishedBag:
            print(f"pidtsm: warning: {warning.message}", file=sys.stderr)
    CONSOLE.print(f"{bag}: used: {source}", highlight=False, soft_wrap=True)
    write_diagnosis_report(page, found, str(options.bag), opened(bag.absolute().parent))
    if options.json:
        print(json.dumps(as_json(found), allow_nan=False))
    else:
        Console().print(_table(found))
        Console().print(sentence(found), highlight=False)
    CONSOLE.print(f"{page}", highlight=False, soft_wrap=True)
    return _NOTHING if found.is_good else _FOUND


def _arm(options: argparse.Namespace, bag: Path) -> tuple[Description | None, str]:
    """What the controller believes of the arm, and what ``--robot`` names it; None: it is not known."""
    definition = read_arm(options)
    if definition is not None:
        return definition.described(), options.robot
    from pidtsm_experiments.commissioning.subjects import believed_arm
    from pidtsm_experiments.runs.saved import read_parameters

    known = read_parameters(bag).get("controller", {})
    if not known:
        return None, "ROBOT"
    source = str(known.get(DESCRIPTION.name, ""))
    if not source or source in ROBOTS:
        return None, "ROBOT"  # Closed forms have no links whose masses could be free.
    label = "ROBOT" if "<" in source else source
    try:
        return believed_arm(known), label
    except ParameterError as error:
        raise UsageError(f"{bag}: the arm of the run: {error}; name it with --robot") from None


def _table(found: Diagnosis) -> Table:
    """The verdicts, what was found first."""
    table = Table(title=f"diagnosis of {found.duration:.3g} s", title_style="bold", box=box.SIMPLE_HEAD)
    for column in ("cause", "verdict", "what was seen", "cure"):
        table.add_column(column, overflow="fold")
    for each in found.verdicts:
        state = f"[bold]{each.state.value}[/bold]" if each.found else each.state.value
        table.add_row(NAMES[each.cause], state, escape(each.text), escape(each.cure))
    return table
