"""``./pidtsm tournament``: every law tuned with the same budget on every arm, then scored."""

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_core.laws import LAWS
from pidtsm_core.robots import NAMES
from pidtsm_core.robots.definition import ArmDefinition, find_arm
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm
from pidtsm_experiments.commands.cluster import workers
from pidtsm_experiments.commands.options import CONSOLE, progress_bar
from pidtsm_experiments.commands.score import made_of
from pidtsm_experiments.commands.tune import budget, identity_of, natural, tune
from pidtsm_experiments.runs.files import write_file
from pidtsm_experiments.runs.locks import locked
from pidtsm_experiments.runs.origin import MadeOf, commit
from pidtsm_experiments.runs.results import renewed, result_folder, settled
from pidtsm_studies.score.criteria import FULL, QUICK, Extent
from pidtsm_studies.score.leaderboard import read_entries, write_leaderboard
from pidtsm_studies.score.measure import measure
from pidtsm_studies.score.plan import Contender
from pidtsm_studies.score.results import FILE, as_json
from pidtsm_studies.score.tasks import find_task
from pidtsm_studies.tuning.definitions import HARDWARE, OBJECTIVES, PARAMETERS
from pidtsm_studies.tuning.search import Budget

_HEAD = """# Tournament

Every law was tuned with the same budget, objective and conditions, and judged on conditions that were not tuned on. A
smaller objective is better; 1 and a little is that of the rule-based set of `piddtsm`. The
[Leaderboard](leaderboard.md) has the scores. `sliding_mode` has its default parts: a linear surface and
a boundary layer.

Made by `./pidtsm tournament {options}` {made}. The seed of every search is {seed}.

| arm | law | objective before | after | before, unseen | after, unseen |
| --- | --- | --- | --- | --- | --- |
"""


@dataclass(frozen=True)
class Cell:
    """A law on an arm; its results are in ``tune/ROBOT/LAW`` and ``score/ROBOT/LAW``."""

    arm: ArmDefinition
    law: str

    @property
    def robot(self) -> str:
        """Name of the arm in results."""
        return self.arm.label

    def folder(self, out: Path, kind: str) -> Path:
        """The folder of its results of a kind, ``tune`` or ``score``."""
        return out / kind / Path(self.robot).stem / self.law


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm_arguments(parser, several=True, of="the tournament (default: all that have a name here)")
    parser.add_argument("--law", action="append", default=[], metavar="NAME", help="only this law; can be repeated")
    parser.add_argument("--hardware", choices=HARDWARE, default="14bit", help="default: %(default)s")
    parser.add_argument(
        "--budget", type=budget, default="600", metavar="N|TIME", help="of each tuning, see tune (default: %(default)s)"
    )
    parser.add_argument("--objective", choices=OBJECTIVES, default="balanced", help="default: %(default)s")
    parser.add_argument("--seed", type=natural, default=0, metavar="N", help="of every search (default: %(default)s)")
    parser.add_argument("--quick", action="store_true", help="quick scores, only to check that everything runs")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers simulate")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("results", "tournament"),
        metavar="DIR",
        help="an unfinished tournament is resumed (default: results/tournament)",
    )


def execute(options: argparse.Namespace) -> int:
    out = settled(options.out)
    common = {"hardware": options.hardware, "objective": options.objective, "seed": options.seed}
    chosen = read_arm(options)
    arms = [find_arm(robot) for robot in options.robot or NAMES] if chosen is None else [chosen]
    cells = [Cell(arm, law) for arm in arms for law in options.law or LAWS.names]
    for cell in cells:
        find_task(cell.arm).experiment(cell.law)
    introduce(options)
    extent = QUICK if options.quick else FULL
    rules = {**common, "budget": asdict(options.budget), "extent": asdict(extent)}
    with workers(options.scheduler):
        _begin(out, rules)
        if not all((cell.folder(out, "score") / FILE).exists() for cell in cells):
            _sign(out)
        for number, cell in enumerate(cells, start=1):
            CONSOLE.print(f"{number} of {len(cells)}: {cell.law} on {cell.robot}", highlight=False)
            tuned = cell.folder(out, "tune")
            if not (tuned / PARAMETERS).exists():
                tuned.parent.mkdir(parents=True, exist_ok=True)
                tune(cell.arm, {**identity_of(cell.arm), "law": cell.law, **common}, options.budget, tuned)
            if not (cell.folder(out, "score") / FILE).exists():
                _score(cell, out, extent)
    entries = read_entries(out / "score")
    made = ("leaderboard.html", "leaderboard.md", "images", "tournament.md")
    with renewed(out, *made, made_of=MadeOf(seed=options.seed)) as folder:
        write_leaderboard(folder, entries)
        (folder / "tournament.md").write_text(_head(out, options) + "".join(_rows(out, cells)), encoding="utf-8")
    CONSOLE.print(f"{out}: leaderboard.html leaderboard.md tournament.md tune/ score/", highlight=False)
    return 0


def _begin(out: Path, rules: dict[str, Any]) -> None:
    """Make the folder, and write the rules; those of a tournament that is resumed must agree.

    Raises:
        UsageError: the folder has a tournament with other rules, or cannot be written.
    """
    file = out / "tournament.json"
    with locked(out):
        if file.exists():
            try:
                known = json.loads(file.read_text(encoding="utf-8"))
                known = {"rules": known["rules"], "made": known["made"]}
            except (OSError, ValueError, KeyError, TypeError):
                raise UsageError(f"{file} is not of a tournament; choose another --out") from None
            if known["rules"] != rules:
                raise UsageError(f"{out} has a tournament with other rules: {known['rules']}; choose another --out")
            return
        try:
            out.mkdir(exist_ok=True)
            if any(out.iterdir()):
                raise UsageError(f"{out} contains other files; choose another --out")
            _write(file, {"rules": rules, "made": []})
        except OSError as error:
            raise UsageError(f"--out {out}: {error.strerror}") from None


def _sign(out: Path) -> None:
    """Add date and commit, unless they are known."""
    file = out / "tournament.json"
    content = json.loads(file.read_text(encoding="utf-8"))
    present = {"date": datetime.now(timezone.utc).date().isoformat(), "commit": commit() or ""}
    if present not in content["made"]:
        _write(file, {**content, "made": [*content["made"], present]})


def _write(file: Path, content: dict[str, Any]) -> None:
    write_file(file, json.dumps(content, indent=2) + "\n")


def _score(cell: Cell, out: Path, extent: Extent) -> None:
    params, task = cell.folder(out, "tune") / PARAMETERS, find_task(cell.arm)
    contender = Contender(cell.law, (str(params),), name=cell.law)
    with result_folder(cell.folder(out, "score"), made_of(task, contender)) as folder, progress_bar() as bar:
        bars = bar.add_task("score", total=None)
        entry = measure(
            task,
            contender,
            extent,
            lambda done, total: bar.update(bars, completed=done, total=total),
        )
        entry = replace(entry, params=(params.relative_to(out).as_posix(),))  # Wherever the tournament is kept.
        (folder / FILE).write_text(json.dumps(as_json(entry), allow_nan=False) + "\n", encoding="utf-8")


def _head(out: Path, options: argparse.Namespace) -> str:
    made = json.loads((out / "tournament.json").read_text(encoding="utf-8"))["made"]
    limit: Budget = options.budget
    budget = limit.evaluations or f"{limit.seconds:g}s"
    chosen = [("robot", robot) for robot in options.robot] + [("law", law) for law in options.law]
    chosen += [("hardware", options.hardware), ("objective", options.objective), ("budget", budget)]
    return _HEAD.format(
        options=" ".join(f"--{name} {value}" for name, value in (*chosen, ("seed", options.seed))),
        made=" and ".join(
            f"on {each['date']}" + (f", commit {each['commit'][:12]}" if each["commit"] else "") for each in made
        ),
        seed=options.seed,
    )


def _rows(out: Path, cells: list[Cell]) -> Iterator[str]:
    for cell in cells:
        content = json.loads((cell.folder(out, "tune") / "tuning.json").read_text(encoding="utf-8"))
        values = [content["cost"][kind][when] for kind in ("training", "validation") for when in ("before", "after")]
        yield f"| {Path(cell.robot).stem} | {cell.law} | {' | '.join(f'{value:.4g}' for value in values)} |\n"
