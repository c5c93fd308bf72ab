"""``./pidtsm tune``: gains for an arm and its hardware, by search on rollouts."""

import argparse
import json
import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from pidtsm_core.control import LAW_NAME
from pidtsm_core.experiment import DEFAULT_ROBOT
from pidtsm_core.experiment.hardware_classes import hardware_names
from pidtsm_core.laws import LAWS
from pidtsm_core.robots.definition import ArmDefinition, find_arm
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm
from pidtsm_experiments.commands.cluster import workers
from pidtsm_experiments.commands.options import CONSOLE, progress_bar
from pidtsm_experiments.runs.origin import MadeOf
from pidtsm_experiments.runs.results import renewed
from pidtsm_studies.score.measure import ORACLE
from pidtsm_studies.tuning.definitions import HARDWARE, OBJECTIVES, PARAMETERS, task_for
from pidtsm_studies.tuning.objective import RULE, make_problem
from pidtsm_studies.tuning.outcome import Tuning, as_json, conclude, parameter_file
from pidtsm_studies.tuning.report import nominal_runs, write_tuning_page
from pidtsm_studies.tuning.search import Budget, Generation, search
from pidtsm_studies.tuning.space import make_space

TUNED = Path("results", "tune")
"""Default folder of all tuned sets."""
HISTORY = "history.jsonl"
_BUDGET = re.compile(r"(\d+(?:\.\d+)?)(s|min|h)|(\d+)")
_SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm_arguments(parser)
    parser.add_argument("--law", metavar="NAME", help=f"one of {', '.join(LAWS.names)} (default: {LAW_NAME.default})")
    parser.add_argument(
        "--hardware", choices=(*HARDWARE, *hardware_names()), default="14bit", help="default: %(default)s"
    )
    parser.add_argument(
        "--budget",
        type=budget,
        default="10min",
        metavar="TIME|N",
        help="time such as 90s, 10min or 1h, or the number of controllers to try, with which a search can be repeated "
        "(default: %(default)s)",
    )
    parser.add_argument("--objective", choices=OBJECTIVES, default="balanced", help="default: %(default)s")
    parser.add_argument(
        "--reference",
        choices=(RULE, ORACLE),
        default=RULE,
        help="what errors are relative to: the rule-based set of the proposed law, or the oracle, which favours no law "
        "(default: %(default)s)",
    )
    parser.add_argument("--seed", type=natural, default=0, metavar="N", help="of the search (default: %(default)s)")
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers simulate, such as tcp://10.0.0.1:8786"
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help=f"an unfinished search is resumed (default: {TUNED}/ROBOT/LAW-HARDWARE)"
    )
    parser.add_argument("--json", action="store_true", help="print only the results, as one JSON object")


def execute(options: argparse.Namespace) -> int:
    arm, law = find_arm(read_arm(options) or DEFAULT_ROBOT), options.law or str(LAW_NAME.default)
    task_for(arm, options.hardware).experiment(law)
    introduce(options)
    out: Path = options.out or TUNED / Path(arm.label).stem / f"{law}-{options.hardware}"
    identity = {
        **identity_of(arm),
        "law": law,
        "hardware": options.hardware,
        "objective": options.objective,
        "seed": options.seed,
        **({} if options.reference == RULE else {"reference": options.reference}),
    }
    with workers(options.scheduler):
        tuning = tune(arm, identity, options.budget, out)
    if options.json:
        print(json.dumps(as_json(tuning), allow_nan=False))
        return 0
    Console().print(_table(tuning))
    CONSOLE.print(f"{out}: {PARAMETERS} tuning.html tuning.json {HISTORY}", highlight=False)
    return 0


def identity_of(arm: ArmDefinition) -> dict[str, Any]:
    """What of the identity of a search is the arm, see `tune`: more than a name only if more is specified."""
    more = {} if arm == ArmDefinition(arm.description) else {"arm": arm.content()}
    return {"robot": arm.label, **more}


def tune(arm: ArmDefinition, identity: dict[str, Any], limit: Budget, out: Path) -> Tuning:
    """Tune, or continue, and write the results.

    Args:
        arm: the arm.
        identity: robot, law, hardware, objective and seed.
        limit: of the search.
        out: result folder.

    Raises:
        UsageError: something unknown, or `out` contains another search or cannot be written.
    """
    task = task_for(arm, identity["hardware"])
    space = make_space(task, identity["law"])
    training, validation = (
        make_problem(task, kind, identity["hardware"], identity["objective"], identity.get("reference", RULE))
        for kind in ("training", "validation")
    )
    first = MadeOf(parameters=task.experiment(identity["law"]).values, seed=identity["seed"])
    with renewed(out, PARAMETERS, "tuning.json", "tuning.html", beside=(HISTORY,), made_of=first) as folder:
        with progress_bar() as bar:
            bars = bar.add_task("controllers", total=1.0)

            def show(known: Sequence[Generation]) -> None:
                lowest = min(min(each.costs) for each in known)
                bar.update(bars, completed=limit.share(known), description=f"objective {lowest:.4g}")

            generations = search(space, training, identity, out / HISTORY, limit, show)
        tuning = conclude(identity, space, generations, training, validation)
        choices = {name: value for name, value in identity.items() if name not in ("robot", "arm")}
        words = [f"--{name} {value}" for name, value in {**choices, "budget": tuning.evaluations}.items()]
        command = " ".join(["./pidtsm tune", shlex.join(arm.words()), *words])
        (folder / PARAMETERS).write_text(parameter_file(tuning, command), encoding="utf-8")
        text = json.dumps(as_json(tuning), allow_nan=False)
        (folder / "tuning.json").write_text(text + "\n", encoding="utf-8")
        write_tuning_page(folder / "tuning.html", tuning, nominal_runs(tuning, training))
    return tuning


def budget(text: str) -> Budget:
    """Parse ``--budget``."""
    found = _BUDGET.fullmatch(text)
    if found and found[3] and int(found[3]) > 0:
        return Budget(evaluations=int(found[3]))
    if found and found[1] and float(found[1]) > 0.0:
        return Budget(seconds=float(found[1]) * _SECONDS[found[2]])
    raise argparse.ArgumentTypeError(f"{text!r} is neither a time (90s, 10min, 1h) nor a number of controllers")


def natural(text: str) -> int:
    """Parse ``--seed``."""
    if not text.isdecimal() or int(text) >= 2**32:
        raise argparse.ArgumentTypeError(f"{text!r} is not an integer from 0 to 2^32 - 1")
    return int(text)


def _table(tuning: Tuning) -> Table:
    table = Table(title=f"{tuning.evaluations} controllers tried", title_style="bold", box=box.SIMPLE_HEAD)
    for column in ("condition", "cost before", "after", "RMSE before", "after", "variation before", "after"):
        table.add_column(column)
    for kind in ("training", "validation"):
        for name, (before, after) in getattr(tuning, kind).items():
            pairs = ((before.cost, after.cost), (before.rmse, after.rmse), (before.variation, after.variation))
            failed = "" if after.success else " [bold red]failed[/]"
            table.add_row(f"{name}{failed}", *(f"{value:.3g}" for pair in pairs for value in pair))
        values = (f"{value:.4g}" for value in tuning.objective(kind))
        table.add_row(f"[bold]objective, {kind}[/]", *values, end_section=True)
    return table
