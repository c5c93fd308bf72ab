"""The page of the study: requirements, tolerances, and every curve."""

from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from pidtsm_core.parameters import Array
from pidtsm_studies.reports.page import Section, write_page
from pidtsm_studies.reports.plots import line_style, set_style
from pidtsm_studies.reports.sections import case_name
from pidtsm_studies.robustness.contenders import LABELS, for_requirements
from pidtsm_studies.robustness.figures import LOGARITHMIC, PANELS, STYLES, band
from pidtsm_studies.robustness.imperfections import IMPERFECTIONS, Imperfection
from pidtsm_studies.robustness.requirements import QUANTITIES, REQUIREMENTS, Requirement
from pidtsm_studies.robustness.results import BAND, CONFIDENCE, LATE, TRACKING, Achievement, Curve, Robustness
from pidtsm_studies.robustness.wording import measured_text, tolerance_text, verdict_text


def write_robustness_report(path: Path, robustness: Robustness) -> None:
    """Write the page; the same results give the same file.

    Args:
        path: the HTML file; an existing one is replaced.
        robustness: the results.
    """
    effort = robustness.effort
    figures = {each.name: _figure(robustness, each) for each in IMPERFECTIONS}
    sections = (
        _section("rows", "Imperfect hardware and limits", "requirements", _requirements(robustness)),
        _section("tolerance", "Tolerance of each controller", "tolerance", _tolerance(robustness)),
        _section("curves", "Curves", "curves", _curves(robustness, figures)),
        _section("method", "Method", "method", _method(robustness)),
    )
    rollouts = f"{robustness.runs} rollouts of {effort.duration:g} s"
    summary = f"{case_name(robustness.scenario)}, {rollouts}, up to {effort.seeds} seeds per value"
    write_page(path, "Robustness", summary, sections, figures)


def _section(name: str, heading: str, template: str, content: Any) -> Section:
    return Section(name, heading, f"robustness/templates/{template}.html", content)


def _requirements(robustness: Robustness) -> dict[str, Any]:
    pairs = zip(REQUIREMENTS, robustness.achievements, strict=True)
    return {
        "caption": verdict_text(robustness),
        "columns": ["hardware", "controller", *QUANTITIES.values(), "success"],
        "requirements": [
            {
                "label": requirement.label,
                "contenders": [
                    {
                        "heading": contender.heading,
                        "cells": _cells(requirement, by_contender[contender.name]),
                        "success": f"{100.0 * by_contender[contender.name].success:.0f} %",
                    }
                    for contender in for_requirements(robustness.contenders)
                ],
            }
            for requirement, by_contender in pairs
        ],
    }


def _cells(requirement: Requirement, achievement: Achievement) -> list[dict[str, Any]]:
    """Value, limit (empty if there is none) and whether the limit is met, for each quantity."""
    kept = achievement.kept(requirement)
    return [
        {
            "value": measured_text(achievement.values[quantity]),
            "limit": f"{limit:g}" if np.isfinite(limit) else "",
            "kept": kept[quantity],
        }
        for quantity, limit in requirement.limits.items()
    ]


def _tolerance(robustness: Robustness) -> dict[str, Any]:
    return {
        "columns": ["imperfection", "tested", *(contender.heading for contender in robustness.contenders)],
        "imperfections": [
            {
                "label": each.label,
                "mildest": f"{robustness.values[each.name][0]:g}",
                "worst": f"{robustness.values[each.name][-1]:g}",
                "cells": [tolerance_text(robustness, each, contender.name) for contender in robustness.contenders],
            }
            for each in IMPERFECTIONS
        ],
    }


def _curves(robustness: Robustness, figures: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "boxes": [
            {"value": each.name, "colour": STYLES[each.name][0], "label": each.label} for each in robustness.contenders
        ],
        "plots": [
            {
                "id": each.name,
                "title": each.label[0].upper() + each.label[1:],
                "height": figures[each.name].layout.height,
            }
            for each in IMPERFECTIONS
        ],
    }


def _method(robustness: Robustness) -> dict[str, Any]:
    """Values for the description of the method, as text."""
    low, middle, high = (f"{percentile:g}" for percentile in BAND)
    return {
        "case": case_name(robustness.scenario),
        "changes": " ".join(robustness.contenders[0].changes),
        "tried": robustness.effort.values,
        "seeds": robustness.effort.seeds,
        "tracking": f"{TRACKING:g}",
        "late": f"{LATE:g}",
        "confidence": f"{100 * CONFIDENCE:g}",
        "low": low,
        "middle": middle,
        "high": high,
        "diverged": robustness.diverged,
        "runs": robustness.runs,
    }


def _figure(robustness: Robustness, imperfection: Imperfection) -> Any:
    """Every contender's curves over an imperfection, one panel per metric."""
    figure = make_subplots(rows=len(PANELS), cols=1, shared_xaxes=True, vertical_spacing=0.035)
    values = np.array(robustness.values[imperfection.name], dtype=np.float64)
    for contender, curve in robustness.curves[imperfection.name].items():
        _draw(figure, contender, curve, values, with_band=imperfection.random)
    set_style(figure, 200 + 190 * len(PANELS))
    ends = np.log10(values[[0, -1]]) if imperfection.logarithmic else values[[0, -1]]
    scale = "log" if imperfection.logarithmic else "linear"
    figure.update_xaxes(type=scale, range=[float(end) for end in ends], exponentformat="power")  # mildest on the left
    if imperfection.logarithmic:
        figure.update_xaxes(dtick=1)
    figure.update_xaxes(title_text=escape(imperfection.label), row=len(PANELS), col=1)
    for row, (panel, name) in enumerate(PANELS.items(), start=1):
        scale = "log" if panel in LOGARITHMIC else "linear"
        figure.update_yaxes(title_text=escape(name).replace("\n", "<br>"), type=scale, row=row, col=1)
    return figure


def _draw(figure: Any, contender: str, curve: Curve, values: Array, with_band: bool) -> None:
    """A contender's curve in every panel, over values of shape (values,)."""
    colour, dashes = STYLES[contender]
    common = {"meta": contender, "name": LABELS[contender], "legendgroup": contender}
    for row, panel in enumerate(PANELS, start=1):
        low, middle, high = band(curve, panel)
        if with_band:
            x, y = _edge(values, low, high)
            shape = {"mode": "none", "fill": "toself", "fillcolor": colour, "opacity": 0.15, "hoverinfo": "skip"}
            figure.add_trace(go.Scatter(x=x, y=y, **shape, **common, showlegend=False), row, 1)
        line = go.Scatter(
            x=values.astype(np.float32),
            y=middle.astype(np.float32),
            **common,
            mode="lines+markers",
            marker={"size": 4, "color": colour},
            line=line_style(colour, dashes),
            showlegend=row == 1,
        )
        figure.add_trace(line, row, 1)


def _edge(values: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Outline of a band; if the band has gaps, one outline per part, separated by nan."""
    exists = np.isfinite(low) & np.isfinite(high)
    parts = np.split(np.arange(values.size), np.flatnonzero(np.diff(exists)) + 1)
    x, y = [np.empty(0)], [np.empty(0)]
    for part in parts:
        if exists[part[0]]:
            x += [values[part], values[part][::-1], np.array([np.nan])]
            y += [low[part], high[part][::-1], np.array([np.nan])]
    return np.concatenate(x).astype(np.float32), np.concatenate(y).astype(np.float32)
