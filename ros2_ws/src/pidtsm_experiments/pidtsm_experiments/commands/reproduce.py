"""``./pidtsm reproduce``: the article's evaluation with the real nodes, compared with its printed results."""

import argparse
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from pidtsm_core.recording.outcome import RAN_AWAY
from pidtsm_experiments.commands.options import CONSOLE, add_parameter_arguments, progress_bar, seconds
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.runs.origin import MadeOf
from pidtsm_experiments.runs.reproduction import LAWS, PRINTED_DTSM, Planned, load, make_runs, plan, write_results
from pidtsm_experiments.runs.results import renewed
from pidtsm_studies.article.claims import compare, markdown
from pidtsm_studies.article.figures import write_article_figures
from pidtsm_studies.reports.labels import CASES, label, value_text
from pidtsm_studies.reports.report import write_report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--out", type=Path, default=Path("results", "reproduce"), metavar="DIR", help="default: results/reproduce"
    )
    parser.add_argument("--resume", action="store_true", help="keep the runs that an interrupted call has completed")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="parallel runs (default: one per core)"
    )
    parser.add_argument("--duration", type=seconds, metavar="S", help="seconds per run, for a quick look (default: 30)")
    parser.add_argument(
        "--scenario", action="append", default=[], metavar="NAME", help="only this case; can be repeated"
    )
    parser.add_argument(
        "--law",
        action="append",
        default=[],
        metavar="NAME",
        help=f"only this one of {', '.join(LAWS)}; can be repeated",
    )
    add_parameter_arguments(parser)


def execute(options: argparse.Namespace) -> int:
    planned = plan(options.duration, options.scenario, options.law, options.params, options.set)
    made_of = MadeOf(runs=tuple(options.out / "runs" / each.key for each in planned))
    names = ("results.json", "comparison.md", "figures", "report.html")
    with renewed(options.out, *names, made_of=made_of) as made:
        failed = _reproduce(planned, options, made)
    CONSOLE.print(f"{options.out}: report.html comparison.md results.json figures/ runs/", highlight=False)
    if failed:
        raise RunError("\n".join(f"{key}: {reason}" for key, reason in failed.items()))
    return 0


def _reproduce(planned: Sequence[Planned], options: argparse.Namespace, made: Path) -> dict[str, str]:
    """Make the runs, and write all results to the folder `made`; returns why runs failed, by key."""
    folder = options.out / "runs"
    folder.mkdir(parents=True, exist_ok=True)
    with progress_bar() as bar:
        total = bar.add_task("all runs", total=sum(p.experiment.duration for p in planned))
        tasks = {p.key: bar.add_task(p.key, total=p.experiment.duration) for p in planned}

        def show(key: str, time: float) -> None:
            bar.update(tasks[key], completed=time)
            bar.update(total, completed=sum(bar.tasks[task].completed for task in tasks.values()))

        failed = make_runs(planned, folder, max(1, options.jobs), options.resume, show)
    with CONSOLE.status("comparing, drawing, writing the report"):
        runs = load(planned, folder, failed)
        notes = [*_changes(options), *_notes(runs)]
        rows = [each for each in compare(runs) if all((each.claim.case, law) in runs for law in each.claim.laws)]
        write_results(runs, rows, made / "results.json")
        (made / "comparison.md").write_text(markdown(rows), encoding="utf-8")
        write_article_figures(runs, made / "figures")
        write_report(made / "report.html", runs, rows, notes)
    CONSOLE.print(_summary(runs))
    return failed


def _changes(options: argparse.Namespace) -> Iterator[str]:
    """A note of the report if the parameters are not those of the evaluation."""
    words = [*(f"--params {name}" for name in options.params), *(f"--set {text}" for text in options.set)]
    if words:
        yield f"The parameters of these runs are not those of the article, because of {' '.join(words)}."


def _notes(runs: dict[tuple[str, str], Any]) -> list[str]:
    """Notes of the report besides the comparison; a run in which the arm ran away is replaced by a sentence."""
    notes = []
    for (scenario, law), run in list(runs.items()):
        if isinstance(run, str) or run[1]["outcome"] != RAN_AWAY:
            continue
        recording, metrics = run
        largest = ", ".join(map(value_text, np.abs(recording.error).max(axis=0)))
        limits = ", ".join(f"{100 * value:.0f} %" for value in metrics["saturation"])
        gains = ", ".join(map(value_text, metrics["adaptive_gain"]))
        sentence = (
            f"leaves its reference: errors up to {largest} rad, torque at its limits {limits} of the time, "
            f"adaptive gain {gains} at the end (joint 1, joint 2)"
        )
        runs[scenario, law] = sentence
        notes.append(f"{label(law)}, {CASES[scenario]}: {sentence}.")
    if isinstance(runs.get(("case1", PRINTED_DTSM)), str):
        notes.append(
            "Table 1 prints kappa = 0.01 for DTSM. All other results of DTSM here are for kappa = 0.3, with which the "
            "law works; the sentence above describes the run with the printed value."
        )
    return notes


def _summary(runs: Mapping[tuple[str, str], Any]) -> Table:
    table = Table(title="joints 1, 2 of each run", box=box.SIMPLE)
    for column in ("case", "law", "RMSE (rad)", "effort variation (N m)", "jumps"):
        table.add_column(column, no_wrap=True)
    for (scenario, law), run in runs.items():
        if isinstance(run, str):
            table.add_row(CASES[scenario], label(law), "see the report")
            continue
        metrics = run[1]
        cells = (", ".join(map(value_text, metrics[key])) for key in ("rmse", "torque_variation", "torque_jumps"))
        table.add_row(CASES[scenario], label(law), *cells)
    return table
