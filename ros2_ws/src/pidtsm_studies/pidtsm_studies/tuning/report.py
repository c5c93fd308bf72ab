"""The page of a tuning: progress, before and after, sensitivity of each gain, and what smoothness costs."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.rollouts.closed_loop import DivergedError, rollout
from pidtsm_core.written import Scale, number
from pidtsm_studies.article.claims import Run
from pidtsm_studies.limit.known import above_limit
from pidtsm_studies.reports.charts import Axis, Line, chart
from pidtsm_studies.reports.curves import QUANTITIES
from pidtsm_studies.reports.events import events
from pidtsm_studies.reports.labels import label, run_entries
from pidtsm_studies.reports.matrix import difference
from pidtsm_studies.reports.page import BAD, GOOD, PLAIN, Answer, Page, Section, write_page
from pidtsm_studies.reports.verdicts import worst_joint
from pidtsm_studies.reports.viewer import viewer_data, viewer_section
from pidtsm_studies.tuning.definitions import NOMINAL
from pidtsm_studies.tuning.objective import Problem, Result
from pidtsm_studies.tuning.outcome import SHIFT, Tuning

_PLAIN = Scale("", 1.0)
_FIRST_CURVES = tuple(each for each in QUANTITIES if each.first)
_LARGEST = 30.0
"""Costs and shares above this are not drawn: they are those of failed runs."""


def nominal_runs(tuning: Tuning, problem: Problem) -> dict[str, Run]:
    """The motion in the nominal condition before and after the tuning; a run that diverges is left out.

    Args:
        tuning: the result.
        problem: what it was tuned on.
    """
    runs: dict[str, Run] = {}
    for name, x in (("before", tuning.space.start), ("after", tuning.x)):
        with suppress(DivergedError):
            recording = rollout(
                problem.task.experiment(str(tuning.identity["law"])),
                duration=problem.task.duration,
                controller=tuning.space.controller(x),
                simulator=problem.conditions[NOMINAL],
            )
            runs[name] = (recording, recording.metrics())
    return runs


def write_tuning_page(path: Path, tuning: Tuning, runs: Mapping[str, Run] | None = None) -> None:
    """Write the page; the same tuning gives the same file.

    Args:
        path: the HTML file; an existing one is replaced.
        tuning: the result.
        runs: see `nominal_runs`; None: nothing moves.
    """
    charts = {"progress": _progress(tuning), "front": _front(tuning)}
    data = None
    if runs:
        happened = {(NOMINAL, name): events(*run, {}) for name, run in runs.items()}
        joint = worst_joint(list(runs.values())[-1][1])
        data = viewer_data({NOMINAL: runs}, run_entries(runs), happened, joint or 0, _FIRST_CURVES)
    sections = (
        *([viewer_section(data, "Gains", "Motion in the nominal condition")] if data else []),
        Section("result", "Before and after", "tuning/templates/result.html", _result(tuning)),
        Section("search", "The search", "tuning/templates/search.html", {"plots": ("progress", "front")}),
        Section("gains", "Gains and their sensitivity", "tuning/templates/gains.html", _gains(tuning), folded=True),
    )
    identity = tuning.identity
    subject = f"{label(identity['law'])} on {Path(identity['robot']).stem}"
    summary = (
        f"Hardware {identity['hardware']}, objective {identity['objective']}, seed {identity['seed']}: "
        f"{tuning.evaluations} controllers tried"
    )
    verdict, state = _verdict(tuning)
    write_page(path, Page(f"Tuning of {subject}", verdict, state, summary, _answers(tuning), sections, data, charts))


def _verdict(tuning: Tuning) -> tuple[str, str]:
    """The tuning in a sentence, and its state."""
    before, after = tuning.objective("validation")
    change = difference(before, after, _PLAIN)
    if not _gained(tuning):
        return f"None of {tuning.evaluations} controllers is better than the first set.", PLAIN
    if after < before:
        fell = f"the objective fell from {number(before)} to {number(after)} ({change})"
        return f"Better also where it was not tuned: {fell}.", GOOD
    rose = f"the objective rose from {number(before)} to {number(after)}"
    return f"Not better where it was not tuned: {rose}.", BAD


def _gained(tuning: Tuning) -> bool:
    """Whether anything that was tried is better than the start."""
    before, after = tuning.objective("training")
    return after < before


def _answers(tuning: Tuning) -> list[Answer]:
    before, after = tuning.objective("training")
    unseen = [pair[1] for pair in tuning.validation.values()]
    succeed = sum(each.success for each in unseen)
    worst = max(tuning.validation, key=lambda name: tuning.validation[name][1].cost)
    most = int(np.argmax(np.abs(tuning.sensitivity).max(axis=0)))
    return [
        Answer(
            "How much was gained?",
            difference(before, after, _PLAIN) if _gained(tuning) else "Nothing",
            f"objective of the conditions tuned on: {number(before)} before, {number(after)} after",
        ),
        Answer(
            "Does it hold elsewhere?",
            f"{succeed} of {len(unseen)} succeed",
            "conditions that the tuning has not seen",
            GOOD if succeed == len(unseen) else BAD,
        ),
        Answer("Which condition is worst?", worst, f"cost {number(tuning.validation[worst][1].cost)}"),
        Answer(
            "Which gain matters most?",
            tuning.space.variables[most].label,
            f"{number(tuning.space.variables[most].value_at(float(tuning.x[most])))} now",
        ),
    ]


def front(rmse: Array, variation: Array) -> Array:
    """Indices of the candidates of which no other has both a smaller RMSE and a smaller variation, by variation.

    Args:
        rmse: of each candidate, relative as in `Result`, shape (candidates,).
        variation: of its torque, relative, same shape.
    """
    order = np.lexsort((rmse, variation))
    lowest = np.minimum.accumulate(rmse[order])
    return order[np.concatenate([[True], rmse[order][1:] < lowest[:-1]])]


def _result(tuning: Tuning) -> dict[str, Any]:
    tables = []
    for kind, caption in (("validation", "Not seen by the tuning"), ("training", "Tuned on")):
        pairs = getattr(tuning, kind)
        highest = max(pair[1].cost for pair in pairs.values())
        rows = [_row(name, before, after, after.cost == highest) for name, (before, after) in pairs.items()]
        first, last = tuning.objective(kind)
        change = difference(first, last, _PLAIN)
        tables.append({"caption": caption, "rows": rows, "before": first, "after": last, "change": change})
    nominal = tuning.training[NOMINAL][1].metrics
    return {"tables": tables, "above": above_limit(tuning.identity["robot"], nominal["rmse"]) if nominal else ""}


def _row(name: str, before: Result, after: Result, worst: bool) -> dict[str, Any]:
    pairs = ((before.cost, after.cost), (before.rmse, after.rmse), (before.variation, after.variation))
    cells = [{"before": a, "after": b, "change": difference(a, b, _PLAIN)} for a, b in pairs]
    return {"name": name, "cells": cells, "success": after.success, "worst": worst}


def _gains(tuning: Tuning) -> dict[str, Any]:
    rows = []
    for i, (each, x) in enumerate(zip(tuning.space.variables, tuning.x.tolist(), strict=True)):
        values = (each.value, each.value_at(x), each.low, each.high, *tuning.sensitivity[:, i].tolist())
        rows.append({"name": each.label, "cells": values})
    return {"rows": rows, "shift": f"{SHIFT:g}"}


def _progress(tuning: Tuning) -> Any:
    lowest = np.array([min(each.costs) for each in tuning.generations])
    middle = np.array([float(np.median(each.costs)) for each in tuning.generations])
    tried = np.cumsum([len(each.costs) for each in tuning.generations])
    found = {"best so far": np.minimum.accumulate(lowest), "median of the generation": middle}
    lines = [
        Line(name, style, tried.astype(np.float64), np.where(values < _LARGEST, values, np.nan))
        for style, (name, values) in enumerate(found.items())
    ]
    return chart(lines, Axis("controllers tried"), Axis("objective"))


def _front(tuning: Tuning) -> Any:
    rmse, variation = (
        np.concatenate([getattr(each, name) for each in tuning.generations]) for name in ("rmse", "variation")
    )
    shown = (rmse < _LARGEST) & (variation < _LARGEST)
    rmse, variation = rmse[shown], variation[shown]
    best = front(rmse, variation) if rmse.size else np.empty(0, dtype=np.int64)
    lines = [Line("tried", 7, variation, rmse, points=4), Line("front", 2, variation[best], rmse[best])]
    for style, (name, i) in enumerate((("before", 0), ("after", 1))):
        pairs = [pair[i] for pair in tuning.training.values()]
        x, y = (np.array([np.mean([getattr(each, n) for each in pairs])]) for n in ("variation", "rmse"))
        lines.append(Line(name, style, x, y, points=12))
    return chart(
        lines,
        Axis("effort variation, relative to a smooth one", logarithmic=True),
        Axis("RMSE, relative to the first set", logarithmic=True),
    )
