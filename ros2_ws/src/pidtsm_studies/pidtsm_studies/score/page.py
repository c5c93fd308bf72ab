"""The page of scores: for each arm a table, and the success of every controller over each range."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go

from pidtsm_core.arrays import Array
from pidtsm_studies.reports.page import Section, write_page
from pidtsm_studies.reports.plots import colour, dashes, line_style, set_style
from pidtsm_studies.score.criteria import CRITERIA, HARDWARE, ROUGHNESS, Criterion, Range
from pidtsm_studies.score.results import CONFIDENCE, Curve, Entry
from pidtsm_studies.score.wording import COLUMNS, arm_of, cells, share_text, title

_HEIGHT = 300


def write_score_page(path: Path, heading: str, entries: Sequence[Entry]) -> None:
    """Write the page; the same entries give the same file.

    Args:
        path: the HTML file; an existing one is replaced.
        heading: of the page.
        entries: at least one.
    """
    figures: dict[str, Any] = {}
    sections = []
    for arm, scored in by_arm(entries).items():
        names = {name: style for style, name in enumerate(dict.fromkeys(title(entry) for entry in entries))}
        plots = {}
        for criterion in CRITERIA:
            for number, each in enumerate(criterion.ranges, start=1):
                plots[f"{arm}-{criterion.name}-{number}"] = _figure(scored, criterion, each, names)
        figures |= plots
        sections.append(Section(arm, arm, "score/templates/arm.html", _arm(arm, scored, plots)))
    sections.append(Section("method", "Method", "score/templates/method.html", _method(entries[0])))
    runs = sum(entry.runs for entry in entries)
    write_page(path, heading, f"{len(entries)} controllers, {runs} rollouts", sections, figures)


def by_arm(entries: Sequence[Entry]) -> dict[str, list[Entry]]:
    """Entries by arm, the best score first."""
    arms: dict[str, list[Entry]] = {}
    for entry in sorted(entries, key=lambda entry: -entry.score):
        arms.setdefault(arm_of(entry), []).append(entry)
    return dict(sorted(arms.items()))


def curve_of(entry: Entry, criterion: Criterion, each: Range) -> Curve:
    """The curve of an entry over a range."""
    outcome = entry.outcomes[CRITERIA.index(criterion)]
    return outcome.curves[criterion.ranges.index(each)]


def success(curve: Curve) -> tuple[Array, Array]:
    """Values, and share of the runs that succeeded at each, shape (values,) both."""
    return np.array(curve.values, dtype=np.float64), np.array(curve.successes, dtype=np.float64) / curve.runs


def axis_text(each: Range) -> str:
    """Label of the axis of a range."""
    return f"{each.label} ({each.unit})"


def _arm(arm: str, entries: Sequence[Entry], plots: Mapping[str, Any]) -> dict[str, Any]:
    task = entries[0].task
    return {
        "arm": arm,
        "task": {
            "motion": f"scenario {task.scenario}" if task.scenario else "every joint swings about its middle",
            "after": f"{task.after:g}",
            "duration": f"{task.duration:g}",
            "error": f"{task.error:g}",
            "payload": f"{task.payload:g}",
            "event": f"{task.event:g}",
        },
        "columns": COLUMNS,
        "rows": [cells(entry) for entry in entries],
        "criteria": ["controller", *(each.name.replace("_", " ") for each in CRITERIA)],
        "shares": [[title(entry), *map(share_text, entry.outcomes)] for entry in entries],
        "plots": [
            {"id": name, "title": figure.layout.xaxis.title.text, "height": _HEIGHT} for name, figure in plots.items()
        ],
    }


def _method(entry: Entry) -> dict[str, Any]:
    return {
        "criteria": [{"name": each.name.replace("_", " "), "label": each.label} for each in CRITERIA],
        "values": entry.extent.values,
        "repeats": entry.extent.repeats,
        "roughness": f"{100.0 * ROUGHNESS:g}",
        "confidence": f"{100.0 * CONFIDENCE:g}",
        "hardware": ", ".join(f"{name}: {value}" for name, value in HARDWARE.items()),
    }


def _figure(entries: Sequence[Entry], criterion: Criterion, each: Range, styles: Mapping[str, int]) -> Any:
    figure = go.Figure()
    for entry in entries:
        x, y = success(curve_of(entry, criterion, each))
        style = styles[title(entry)]
        figure.add_trace(
            go.Scatter(
                x=x.astype(np.float32),
                y=y.astype(np.float32),
                name=title(entry),
                mode="lines+markers",
                marker={"size": 4, "color": colour(style)},
                line=line_style(colour(style), dashes(style)),
                showlegend=True,
            )
        )
    set_style(figure, _HEIGHT)
    figure.update_xaxes(title_text=escape(axis_text(each)), type="log" if each.logarithmic else "linear")
    if each.last < each.first:
        figure.update_xaxes(autorange="reversed")
    figure.update_yaxes(title_text="success", range=[-0.05, 1.05])
    return figure
