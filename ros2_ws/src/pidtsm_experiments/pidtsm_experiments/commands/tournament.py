"""``./pidtsm tournament``: every law tuned with the same budget on every arm, by several searches, then scored."""

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment.hardware_classes import hardware_names
from pidtsm_core.laws import LAWS
from pidtsm_core.recording.provenance import commit
from pidtsm_core.robots import NAMES
from pidtsm_core.robots.definition import ArmDefinition, find_arm
from pidtsm_experiments.commands.arm_options import add_arm_arguments, introduce, read_arm
from pidtsm_experiments.commands.cluster import workers
from pidtsm_experiments.commands.options import CONSOLE
from pidtsm_experiments.commands.score import made_of, scored
from pidtsm_experiments.commands.tournament_time import say_time
from pidtsm_experiments.commands.tune import budget, identity_of, natural, tune
from pidtsm_experiments.runs.files import write_file
from pidtsm_experiments.runs.locks import locked
from pidtsm_experiments.runs.origin import MadeOf
from pidtsm_experiments.runs.results import renewed, result_folder, settled
from pidtsm_studies.score.criteria import Extent, extent_of
from pidtsm_studies.score.leaderboard import write_leaderboard
from pidtsm_studies.score.measure import ORACLE
from pidtsm_studies.score.plan import CONTROL, Contender, bad_gains
from pidtsm_studies.score.results import FILE, Entry, as_json, read_entry
from pidtsm_studies.score.tasks import ON_HARDWARE, Task, find_task
from pidtsm_studies.tuning.definitions import HARDWARE, OBJECTIVES, PARAMETERS, class_of, task_for
from pidtsm_studies.tuning.search import Budget

OWN = "own"
"""The hardware that each arm has by itself."""
_HEAD = """# Tournament

Every law was tuned by searches with the same budget, objective and conditions ({seeds} of {budget} each), from the
start that its own rule gives, and judged on conditions that were not tuned on (*unseen*). Errors are relative to those
of the oracle, which favours no law; a smaller objective is better. The search with the best objective in training gives
the row of a law in the [Leaderboard](leaderboard.md). *all* has mean and standard deviation over the searches.

Made by `./pidtsm tournament {options}` {made}.

| arm | law | objective before | after, best | after, all | unseen, best | unseen, all | score, best | score, all |
| --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""


@dataclass(frozen=True)
class Cell:
    """A law on an arm with some hardware; results are in ``tune/ARM/LAW/SEED`` and ``score/ARM/LAW/SEED``."""

    arm: ArmDefinition
    law: str
    hardware: str

    @property
    def robot(self) -> str:
        """Name of the arm in results."""
        return self.arm.label

    @property
    def task(self) -> Task:
        """What its result is scored on: on a class of hardware, if it was tuned for one."""
        return scoring_task(self.arm, self.hardware)

    def folder(self, out: Path, kind: str, seed: int) -> Path:
        """The folder of the results of a search, of a kind, ``tune`` or ``score``."""
        return out / kind / Path(self.robot).stem / self.law / f"seed-{seed}"

    def objectives(self, out: Path, seed: int) -> dict[str, dict[str, float]]:
        """Objectives of a search in training and validation, before and after."""
        content = json.loads((self.folder(out, "tune", seed) / "tuning.json").read_text(encoding="utf-8"))
        cost: dict[str, dict[str, float]] = content["cost"]
        return cost

    def best(self, out: Path, seeds: int) -> int:
        """The search with the best objective in training; the first one of several."""
        return min(range(seeds), key=lambda seed: self.objectives(out, seed)["training"]["after"])


def scoring_task(arm: ArmDefinition, hardware: str) -> Task:
    """What an arm with this hardware of the tuner is scored on."""
    return task_for(arm, hardware) if class_of(hardware) else find_task(arm)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm_arguments(parser, several=True, of="the tournament (default: all that have a name here)")
    parser.add_argument("--law", action="append", default=[], metavar="NAME", help="only this law; can be repeated")
    parser.add_argument(
        "--hardware",
        choices=(OWN, *hardware_names(), *HARDWARE),
        default=OWN,
        help="that gains are tuned for: a class of hardware, on which they are then scored too; the arm's own one "
        "(default); or an encoder on otherwise ideal hardware, scored around ideal hardware",
    )
    parser.add_argument(
        "--budget", type=budget, default="600", metavar="N|TIME", help="of each search, see tune (default: %(default)s)"
    )
    parser.add_argument("--objective", choices=OBJECTIVES, default="balanced", help="default: %(default)s")
    parser.add_argument(
        "--seeds", type=_several, default=3, metavar="N", help="searches for each law and arm (default: %(default)s)"
    )
    parser.add_argument("--quick", action="store_true", help="quick scores, only to check that everything runs")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers simulate")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("results", "tournament"),
        metavar="DIR",
        help="an unfinished tournament is resumed (default: results/tournament)",
    )


def _several(text: str) -> int:
    """Parse ``--seeds``."""
    if not (count := natural(text)):
        raise argparse.ArgumentTypeError("at least one search is needed")
    return count


def execute(options: argparse.Namespace) -> int:
    out, seeds = settled(options.out), options.seeds
    chosen = read_arm(options)
    arms = [find_arm(robot) for robot in options.robot or NAMES] if chosen is None else [chosen]
    cells = [Cell(arm, law, _hardware(options, arm)) for arm in arms for law in options.law or LAWS.names]
    for cell in cells:
        cell.task.experiment(cell.law)
    introduce(options)
    common = {"objective": options.objective, "reference": ORACLE}
    extent = extent_of(cells[0].task.base, options.quick)
    rules = {**common, "hardware": options.hardware, "seeds": seeds}
    rules |= {"budget": asdict(options.budget), "extent": asdict(extent)}
    searches = [(cell, seed) for cell in cells for seed in range(seeds)]
    with workers(options.scheduler):
        _begin(out, rules)
        left = [each for each in searches if not (each[0].folder(out, "score", each[1]) / FILE).exists()]
        if left:
            _sign(out)
            say_time([(cell.arm, cell.law, cell.hardware, cell.task) for cell, _ in left], options.budget, extent)
        for number, (cell, seed) in enumerate(searches, start=1):
            CONSOLE.print(f"{number} of {len(searches)}: {cell.law} on {cell.robot}, seed {seed}", highlight=False)
            tuned = cell.folder(out, "tune", seed)
            if not (tuned / PARAMETERS).exists():
                tuned.parent.mkdir(parents=True, exist_ok=True)
                identity = {**identity_of(cell.arm), "law": cell.law, "hardware": cell.hardware}
                identity |= {"objective": options.objective, "seed": seed, "reference": ORACLE}
                tune(cell.arm, identity, options.budget, tuned)
            if not (cell.folder(out, "score", seed) / FILE).exists():
                params = tuned / PARAMETERS
                _score(
                    cell.task,
                    Contender(cell.law, (str(params),), name=cell.law),
                    cell.folder(out, "score", seed),
                    out,
                    extent,
                )
        entries = [*_references(out, cells, extent), *(_best_entry(cell, out, seeds) for cell in cells)]
    made = ("leaderboard.html", "leaderboard.md", "images", "tournament.md")
    with renewed(out, *made, made_of=MadeOf(seed=0)) as folder:
        write_leaderboard(folder, entries)
        rows = _head(out, options) + "".join(_rows(out, cells, seeds))
        (folder / "tournament.md").write_text(rows, encoding="utf-8")
    CONSOLE.print(f"{out}: leaderboard.html leaderboard.md tournament.md tune/ score/", highlight=False)
    return 0


def _hardware(options: argparse.Namespace, arm: ArmDefinition) -> str:
    """The hardware of an arm of the tournament."""
    return str(find_task(arm, None, ON_HARDWARE).hardware) if options.hardware == OWN else options.hardware


def _best_entry(cell: Cell, out: Path, seeds: int) -> Entry:
    return read_entry(cell.folder(out, "score", cell.best(out, seeds)) / FILE)


def _references(out: Path, cells: list[Cell], extent: Extent) -> Iterator[Entry]:
    """The oracle and the control row of each arm, on a class of hardware."""
    for cell in {cell.robot: cell for cell in cells if cell.task.base == ON_HARDWARE}.values():
        folder = out / "score" / Path(cell.robot).stem
        oracle = Contender(None, name=ORACLE, oracle=True)
        for contender, name in ((oracle, ORACLE), (bad_gains(cell.task), CONTROL.replace(" ", "_"))):
            if not (folder / name / FILE).exists():
                _score(cell.task, contender, folder / name, out, extent)
            yield read_entry(folder / name / FILE)


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


def _score(task: Task, contender: Contender, target: Path, out: Path, extent: Extent) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    with result_folder(target, made_of(task, contender)) as folder:
        entry = scored(task, contender, extent)
        # Wherever the tournament is kept.
        within = (
            Path(each).relative_to(out).as_posix() if Path(each).is_relative_to(out) else each for each in entry.params
        )
        entry = replace(entry, params=tuple(within))
        (folder / FILE).write_text(json.dumps(as_json(entry), allow_nan=False) + "\n", encoding="utf-8")


def _head(out: Path, options: argparse.Namespace) -> str:
    made = json.loads((out / "tournament.json").read_text(encoding="utf-8"))["made"]
    limit: Budget = options.budget
    budget = limit.evaluations or f"{limit.seconds:g}s"
    chosen = [("robot", robot) for robot in options.robot] + [("law", law) for law in options.law]
    chosen += [("hardware", options.hardware), ("objective", options.objective), ("budget", budget)]
    chosen += [("seeds", options.seeds)]
    return _HEAD.format(
        options=" ".join(f"--{name} {value}" for name, value in chosen),
        made=" and ".join(
            f"on {each['date']}" + (f", commit {each['commit'][:12]}" if each["commit"] else "") for each in made
        ),
        seeds=options.seeds,
        budget=budget,
    )


def _rows(out: Path, cells: list[Cell], seeds: int) -> Iterator[str]:
    for cell in cells:
        best, costs = cell.best(out, seeds), [cell.objectives(out, seed) for seed in range(seeds)]
        scores = [read_entry(cell.folder(out, "score", seed) / FILE).score for seed in range(seeds)]
        values = [f"{costs[best]['training']['before']:.4g}"]
        for kind in ("training", "validation"):
            after = [each[kind]["after"] for each in costs]
            values += [f"{after[best]:.4g}", _spread(after)]
        values += [f"{100.0 * scores[best]:.1f} %", _spread([100.0 * score for score in scores])]
        yield f"| {Path(cell.robot).stem} | {cell.law} | {' | '.join(values)} |\n"


def _spread(values: list[float]) -> str:
    """Mean and standard deviation over the searches."""
    deviation = f" ± {np.std(values, ddof=1):.2g}" if len(values) > 1 else ""
    return f"{np.mean(values):.4g}{deviation}"
