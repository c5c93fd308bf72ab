"""The page of scores: for each arm bars, criteria and the success of every controller over each range."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.recording.metric import EFFORT_VARIATION, MEAN_EFFORT, RMSE, Metric
from pidtsm_core.units import TURNS
from pidtsm_core.written import THIN, number, scale
from pidtsm_studies.limit.known import above_limit
from pidtsm_studies.reports.charts import Axis, Line, chart
from pidtsm_studies.reports.labels import label
from pidtsm_studies.reports.page import PLAIN, Answer, Page, Section, write_page
from pidtsm_studies.reports.styles import looks
from pidtsm_studies.score.criteria import HARDWARE, ROUGHNESS, Criterion, Range, criteria_of, levels_of
from pidtsm_studies.score.groups import by_arm, ceiling, rivals
from pidtsm_studies.score.intervals import CONFIDENCE
from pidtsm_studies.score.results import Curve, Entry
from pidtsm_studies.score.tasks import ON_HARDWARE, Task
from pidtsm_studies.score.wording import arm_of, combined, title

_RUNS = {"ideal": "ideal", "hardware": "14 bit and 1 ms"}
"""The nominal runs and their names, with ideal hardware."""
_METRICS = (RMSE, MEAN_EFFORT, EFFORT_VARIATION)
"""The columns of a nominal run."""
_STEADY = replace(RMSE, key="steady_rmse", name="RMSE, steady")
_TRANSIENT = replace(RMSE, key="transient_rmse", name="RMSE, transient")
_METRICS_ON_HARDWARE = (_STEADY, _TRANSIENT, MEAN_EFFORT, EFFORT_VARIATION)
"""Likewise, on hardware."""


def write_score_page(path: Path, heading: str, entries: Sequence[Entry]) -> None:
    """Write the page; the same entries give the same file.

    Args:
        path: the HTML file; an existing one is replaced.
        heading: of the page.
        entries: at least one.
    """
    arms = by_arm(entries)
    styles = {name: style for style, name in enumerate(dict.fromkeys(title(entry) for entry in entries))}
    charts: dict[str, Any] = {}
    sections = []
    if len(entries) > 1 or len(_runs_of(entries)) > 1:
        sections.append(Section("filters", "Show", "score/templates/filters.html", _filters(entries)))
    if len(arms) > 1:
        sections.append(Section("overview", "Every arm", "score/templates/overview.html", _overview(arms, styles)))
    for number_of_arm, (arm, scored) in enumerate(arms.items()):
        plots = {
            f"{arm}-{criterion.name}-{i}": _chart(scored, criterion, each, styles)
            for criterion in criteria_of(scored[0].task.base)
            for i, each in enumerate(criterion.ranges, start=1)
        }
        charts |= plots
        content = _arm(arm, scored, list(plots), styles) | {"open": number_of_arm == 0}
        sections.append(Section(arm, arm, "score/templates/arm.html", content))
    sections.append(Section("method", "Method", "score/templates/method.html", _method(entries[0]), folded=True))
    runs = sum(entry.runs for entry in entries)
    count = f"{len(entries)} controller{'s' if len(entries) > 1 else ''}"
    summary = f"{count}, {number(runs)} rollouts"
    write_page(path, Page(heading, _verdict(arms), PLAIN, summary, _answers(arms), sections, None, charts))


def curve_of(entry: Entry, criterion: Criterion, each: Range) -> Curve:
    """The curve of an entry over a range."""
    outcome = next(found for found in entry.outcomes if found.criterion == criterion)
    return outcome.curves[criterion.ranges.index(each)]


def success(curve: Curve) -> tuple[Array, Array]:
    """Values, and share of the runs that succeeded at each, shape (values,) both."""
    return np.array(curve.values, dtype=np.float64), np.array(curve.successes, dtype=np.float64) / curve.runs


def axis_text(each: Range) -> str:
    """Label of the axis of a range."""
    return f"{each.label} ({each.unit})"


def _runs_of(entries: Sequence[Entry]) -> dict[str, str]:
    """The nominal runs of entries, and their names."""
    runs = dict.fromkeys(name for entry in entries for name in entry.nominal)
    return {name: _RUNS.get(name, name.replace("_", " ")) for name in runs}


def _metrics_of(entries: Sequence[Entry]) -> tuple[Metric, ...]:
    """The columns of the nominal runs of a table."""
    return _METRICS_ON_HARDWARE if entries[0].task.base == ON_HARDWARE else _METRICS


def _verdict(arms: Mapping[str, Sequence[Entry]]) -> str:
    only = _only(arms)
    if only:
        possible = _possible(only, ceiling(next(iter(arms.values()))))
        what = f", {possible} of what is possible" if possible else ""
        return f"{title(only)} succeeds in {_share(only.score)} of the runs{what}; {_worst(only)} is hardest."
    firsts = [rivals(scored)[0] for scored in arms.values()]
    best = max(firsts, key=lambda entry: entry.score)
    leads: dict[str, int] = {}
    for entry in firsts:
        leads[title(entry)] = leads.get(title(entry), 0) + 1
    leader = max(leads, key=lambda name: leads[name])
    return (
        f"{leader} leads on {leads[leader]} of {len(arms)} arm{'s' if len(arms) > 1 else ''}; the highest score is "
        f"{_share(best.score)} of the runs ({title(best)} on {arm_of(best)})."
    )


def _answers(arms: Mapping[str, Sequence[Entry]]) -> list[Answer]:
    every = [entry for scored in arms.values() for entry in rivals(scored)]
    names = dict.fromkeys(outcome.criterion.name for entry in every for outcome in entry.outcomes)
    shares = {name: _mean_share(every, name) for name in names}
    hardest, easiest = min(shares, key=lambda c: shares[c]), max(shares, key=lambda c: shares[c])
    answers = [
        Answer("What is hardest?", hardest.replace("_", " "), f"{_share(shares[hardest])} of its runs succeed"),
        Answer("What is easiest?", easiest.replace("_", " "), f"{_share(shares[easiest])} of its runs succeed"),
    ]
    if only := _only(arms):
        interval = _interval(only)
        return [
            Answer("How good is it?", _share(only.score), f"with other seeds {interval}" if interval else ""),
            *answers,
        ]
    tables = [rivals(scored) for scored in arms.values()]
    leads = [100.0 * (scored[0].score - scored[1].score) for scored in tables if len(scored) > 1]
    points = list(dict.fromkeys(number(lead, 2) for lead in (min(leads), max(leads)))) if leads else []
    by = f"by {' to '.join(points)} points over the next" if leads else ""
    who = ", ".join(dict.fromkeys(title(scored[0]) for scored in tables))
    place, hard = min(zip(arms, tables, strict=True), key=lambda each: each[1][0].score)
    where = Answer("Which arm is hardest?", place, f"the best controller reaches {_share(hard[0].score)}")
    return [Answer("Who leads?", who, by), *answers, *([where] if len(arms) > 1 else [])]


def _only(arms: Mapping[str, Sequence[Entry]]) -> Entry | None:
    """The controller of a page that has a single one beside the oracle and the control row; None: it has more."""
    every = [entry for scored in arms.values() for entry in rivals(scored)]
    return every[0] if len(every) == 1 else None


def _interval(entry: Entry) -> str:
    """The interval of a score; empty if it has no width, as of a single seed."""
    low, high = entry.interval
    return f"{_share(low)} to {_share(high)}" if low < high else ""


def _possible(entry: Entry, oracle: Entry | None) -> str:
    """The score relative to that of the oracle; empty if that is not known, or this is the oracle."""
    return _share(entry.score / oracle.score) if oracle and oracle.score and entry is not oracle else ""


def _overview(arms: Mapping[str, Sequence[Entry]], styles: Mapping[str, int]) -> dict[str, Any]:
    """A row for each controller, the best mean score first, with its score on every arm."""
    scores: dict[str, dict[str, Entry]] = {}
    for arm, scored in arms.items():
        for entry in scored:
            scores.setdefault(title(entry), {})[arm] = entry
    ranked = sorted(scores, key=lambda name: -float(np.mean([entry.score for entry in scores[name].values()])))
    rows = []
    for name in ranked:
        cells = [
            {"value": found.score, "text": _share(found.score), "best": found is rivals(scored)[0]} if found else None
            for arm, scored in arms.items()
            for found in (scores[name].get(arm),)
        ]
        law = next(iter(scores[name].values())).law
        rows.append({"name": name, "look": looks(styles[name]), "tags": json.dumps({"law": law}), "cells": cells})
    return {"arms": [{"name": arm, "tags": json.dumps({"arm": arm})} for arm in arms], "rows": rows}


def _mean_share(entries: Sequence[Entry], criterion: str) -> float:
    """The mean share of a criterion over the entries that have it."""
    return float(np.mean([o.share for entry in entries for o in entry.outcomes if o.criterion.name == criterion]))


def _filters(entries: Sequence[Entry]) -> dict[str, Any]:
    laws: dict[str, list[str]] = {}
    for entry in entries:
        names = laws.setdefault(entry.law, [])
        names += [title(entry)] if title(entry) not in names else []
    return {
        "arms": sorted({arm_of(entry) for entry in entries}),
        "laws": [{"law": law, "label": label(law), "series": json.dumps(names)} for law, names in sorted(laws.items())],
        "hardware": _runs_of(entries),
        "choice": "Motion" if all(entry.task.base == ON_HARDWARE for entry in entries) else "Hardware",
    }


def _arm(arm: str, entries: Sequence[Entry], plots: Sequence[str], styles: Mapping[str, int]) -> dict[str, Any]:
    task = entries[0].task
    return {
        "arm": arm,
        "tags": json.dumps({"arm": arm}),
        "task": {
            "motion": _motion_text(task),
            "after": number(task.after),
            "duration": number(task.duration),
            "error": number(task.error),
            "payload": number(task.payload),
            "event": number(task.event),
        },
        "oracle": ceiling(entries) is not None,
        "heads": [metric.name for metric in _metrics_of(entries)],
        "units": _units(entries),
        "hardware": _runs_of(entries),
        "rows": [_row(entry, styles, _scales(entries), ceiling(entries)) for entry in entries],
        "criteria": [each.name.replace("_", " ") for each in criteria_of(task.base)],
        "plots": [
            {"id": name, "title": criterion.name.replace("_", " "), "about": axis_text(each)}
            for name, (criterion, each) in zip(
                plots, [(c, r) for c in criteria_of(task.base) for r in c.ranges], strict=True
            )
        ],
    }


def _motion_text(task: Task) -> str:
    if task.base == ON_HARDWARE:
        return "sines, pick and place with rests, reversals at 3 degrees/s, and fast moves"
    return f"scenario {task.scenario}" if task.scenario else "every joint swings about its middle"


def _scales(entries: Sequence[Entry]) -> dict[str, Any]:
    """A common unit for each metric of all entries."""
    runs = [found for entry in entries for found in entry.nominal.values() if found is not None]
    metrics = _metrics_of(entries)
    return {m.key: scale([combined(m.key, run[m.key]) for run in runs], m.unit_of(TURNS)) for m in metrics}


def _units(entries: Sequence[Entry]) -> list[str]:
    return [each.unit for each in _scales(entries).values()]


def _row(entry: Entry, styles: Mapping[str, int], scales: Mapping[str, Any], oracle: Entry | None) -> dict[str, Any]:
    low, high = entry.interval
    possible, hardest = _possible(entry, oracle), min(outcome.share for outcome in entry.outcomes)
    ideal = entry.nominal.get("ideal")
    return {
        "name": title(entry),
        "look": looks(styles[title(entry)]),
        "tags": json.dumps({"arm": arm_of(entry), "law": entry.law}),
        "score": entry.score,
        "text": _share(entry.score),
        "notes": "; ".join(filter(None, (_interval(entry), possible and f"{possible} of what is possible"))),
        "low": low,
        "high": high,
        "above": above_limit(entry.task.robot, ideal["rmse"]) if ideal else "",
        "shares": [
            {"value": outcome.share, "text": _share(outcome.share), "worst": outcome.share == hardest}
            for outcome in entry.outcomes
        ],
        "nominal": {run: _nominal(entry, run, scales) for run in entry.nominal},
    }


def _nominal(entry: Entry, run: str, scales: Mapping[str, Any]) -> dict[str, Any]:
    found = entry.nominal[run]
    cells = None
    if found is not None:
        values = {key: combined(key, found[key]) for key in scales}
        cells = [{"value": value, "text": number(scales[key].factor * value)} for key, value in values.items()]
    return {"cells": cells, "failed": not entry.succeeds[run]}


def _share(value: float) -> str:
    return f"{number(100.0 * value)}{THIN}%"


def _worst(entry: Entry) -> str:
    return f"{entry.worst.criterion.name.replace('_', ' ')} ({_share(entry.worst.share)})"


def _method(entry: Entry) -> dict[str, Any]:
    return {
        "criteria": [
            {"name": each.name.replace("_", " "), "label": each.label} for each in criteria_of(entry.task.base)
        ],
        "around": f"hardware of the class {entry.task.hardware}" if entry.task.base == ON_HARDWARE else "",
        "levels": ", ".join(number(1e3 * level) for level in levels_of(entry.task)),
        "values": entry.extent.values,
        "repeats": entry.extent.repeats,
        "roughness": number(100.0 * ROUGHNESS),
        "confidence": number(100.0 * CONFIDENCE),
        "hardware": ", ".join(f"{name}: {value}" for name, value in HARDWARE.items()),
    }


def _chart(entries: Sequence[Entry], criterion: Criterion, each: Range, styles: Mapping[str, int]) -> dict[str, Any]:
    lines = [Line(title(entry), styles[title(entry)], *success(curve_of(entry, criterion, each))) for entry in entries]
    x = Axis(axis_text(each), logarithmic=each.logarithmic, reversed=each.last < each.first)
    return chart(lines, x, Axis("success", range=(-0.05, 1.05)))
