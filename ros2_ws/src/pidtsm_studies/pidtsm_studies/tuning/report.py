"""The page of a tuning: progress, before and after, sensitivity of each gain, and what smoothness costs."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go

from pidtsm_core.arrays import Array
from pidtsm_studies.limit.known import above_limit
from pidtsm_studies.reports.labels import label, value_text
from pidtsm_studies.reports.page import Section, write_page
from pidtsm_studies.reports.plots import colour, set_style
from pidtsm_studies.tuning.definitions import NOMINAL
from pidtsm_studies.tuning.objective import Result
from pidtsm_studies.tuning.outcome import SHIFT, Tuning

_HEIGHT = 360
_LARGEST = 30.0
"""Costs and shares above this are not drawn: they are those of failed runs."""


def write_tuning_page(path: Path, tuning: Tuning) -> None:
    """Write the page; the same tuning gives the same file.

    Args:
        path: the HTML file; an existing one is replaced.
        tuning: the result.
    """
    figures = {"progress": _progress(tuning), "front": _front(tuning)}
    plot = {"height": _HEIGHT}
    sections = (
        Section("result", "Before and after", "tuning/templates/result.html", _result(tuning)),
        Section("gains", "Gains and their sensitivity", "tuning/templates/gains.html", _gains(tuning)),
        Section("search", "Progress", "tuning/templates/progress.html", plot),
        Section("smoothness", "RMSE against torque variation", "tuning/templates/front.html", plot),
    )
    identity = tuning.identity
    summary = (
        f"{label(identity['law'])} on {Path(identity['robot']).stem}, hardware {identity['hardware']}, objective "
        f"{identity['objective']}, seed {identity['seed']}: {tuning.evaluations} controllers tried"
    )
    write_page(path, "Tuning", summary, sections, figures)


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
    for kind, caption in (("training", "Tuned on"), ("validation", "Not seen by the tuning")):
        rows = [_row(name, *pair) for name, pair in getattr(tuning, kind).items()]
        before, after = tuning.objective(kind)
        tables.append({"caption": caption, "rows": rows, "before": f"{before:.4g}", "after": f"{after:.4g}"})
    nominal = tuning.training[NOMINAL][1].metrics
    return {"tables": tables, "above": above_limit(tuning.identity["robot"], nominal["rmse"]) if nominal else ""}


def _row(name: str, before: Result, after: Result) -> dict[str, Any]:
    return {
        "name": name,
        "cells": [
            value_text(value)
            for pair in ((before.cost, after.cost), (before.rmse, after.rmse), (before.variation, after.variation))
            for value in pair
        ],
        "success": after.success,
    }


def _gains(tuning: Tuning) -> dict[str, Any]:
    rows = []
    for i, (each, x) in enumerate(zip(tuning.space.variables, tuning.x.tolist(), strict=True)):
        values = (each.value, each.value_at(x), each.low, each.high, *tuning.sensitivity[:, i].tolist())
        rows.append({"name": each.label, "cells": [f"{value:.4g}" for value in values]})
    return {"rows": rows, "shift": f"{SHIFT:g}"}


def _progress(tuning: Tuning) -> Any:
    lowest = np.array([min(each.costs) for each in tuning.generations])
    middle = np.array([float(np.median(each.costs)) for each in tuning.generations])
    tried = np.cumsum([len(each.costs) for each in tuning.generations])
    figure = go.Figure()
    lines = {"best so far": np.minimum.accumulate(lowest), "median of the generation": middle}
    for style, (name, values) in enumerate(lines.items()):
        shown = np.where(values < _LARGEST, values, np.nan)
        figure.add_trace(_scatter(tried, shown, name, "lines+markers", style))
    set_style(figure, _HEIGHT)
    figure.update_xaxes(title_text="controllers tried")
    figure.update_yaxes(title_text="objective")
    return figure


def _front(tuning: Tuning) -> Any:
    rmse, variation = (
        np.concatenate([getattr(each, name) for each in tuning.generations]) for name in ("rmse", "variation")
    )
    shown = (rmse < _LARGEST) & (variation < _LARGEST)
    rmse, variation = rmse[shown], variation[shown]
    best = front(rmse, variation) if rmse.size else np.empty(0, dtype=np.int64)
    figure = go.Figure()
    figure.add_trace(_scatter(variation, rmse, "tried", "markers", 3))
    figure.add_trace(_scatter(variation[best], rmse[best], "front", "lines+markers", 2))
    for style, (name, i) in enumerate((("before", 0), ("after", 1))):
        pairs = [pair[i] for pair in tuning.training.values()]
        x, y = (np.array([np.mean([getattr(each, n) for each in pairs])]) for n in ("variation", "rmse"))
        figure.add_trace(_scatter(x, y, name, "markers", style, size=12))
    set_style(figure, _HEIGHT)
    figure.update_xaxes(title_text="torque variation, relative to a smooth one", type="log")
    figure.update_yaxes(title_text="RMSE, relative to the rule-based set", type="log")
    return figure


def _scatter(x: Array, y: Array, name: str, mode: str, style: int, size: int = 4) -> Any:
    look: Mapping[str, Any] = {"marker": {"size": size, "color": colour(style)}, "line": {"color": colour(style)}}
    return go.Scatter(x=x.astype(np.float32), y=y.astype(np.float32), name=name, mode=mode, **look)
