"""Sections that reports of runs share: their content as plain data for the templates, and their plots."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Any, TypeAlias

from pidtsm_core.parameters import ParameterError
from pidtsm_core.recording.outcome import OF_TRACKING, RAN_AWAY, what_happened
from pidtsm_core.units import either
from pidtsm_studies.article.claims import Run
from pidtsm_studies.reports.animation import animation
from pidtsm_studies.reports.labels import CASES, Entry, difference_text, value_text
from pidtsm_studies.reports.page import Section
from pidtsm_studies.reports.plots import QUANTITIES, colour, plot

Cases: TypeAlias = Mapping[str, Mapping[str, Run]]
"""Runs that are drawn over each other, by case, and by law or name."""

# Key, name, unit and factor. In a name, {position} and {effort} are the units of all joints, in a unit those of one.
_METRICS = (
    ("max_error", "largest error, max |e|", "{position}", 1.0),
    ("rmse", "RMSE, root of the mean of e²", "{position}", 1.0),
    ("eci", "ECI, mean |τ|", "{effort}", 1.0),
    ("steady_state_error", "steady-state error, max |e| over the last 40 % of the run", "{position}", 1.0),
    ("settling_time", "settling time, until |e| stays below 2 % of its start", "s", 1.0),
    ("recovery_time", "recovery time, from the event until |e| stays below 1e-3 {position}", "s", 1.0),
    ("torque_variation", "effort variation, mean change from sample to sample", "{effort}", 1.0),
    ("torque_variation_rate", "effort variation per second", "{effort}/s", 1.0),
    ("torque_jumps", "effort jumps, samples at which it changes by more than 5 {effort}", "", 1.0),
    ("saturation", "effort at its limit or that of its rate, share of the samples", "%", 100.0),
    ("time_at_effort_limit", "effort at its limit", "s", 1.0),
    ("time_at_rate_limit", "effort at the limit of its rate", "s", 1.0),
    ("adaptive_gain", "adaptive gain Υ at the end", "", 1.0),
)


@dataclass(frozen=True)
class Drawings:
    """What the script of a page draws.

    Attributes:
        figures: plotly figures by id.
        arm: data of the animation, see `animation.animation`; None: there is none.
        reason: why there is no animation; empty if there is one, or nothing to animate.
    """

    figures: Mapping[str, Any]
    arm: Mapping[str, Any] | None
    reason: str


def draw(cases: Cases, entries: Mapping[str, Entry]) -> Drawings:
    """Plots of all quantities, and the animation if the descriptions of all arms can be read."""
    figures = {
        f"{case}-{quantity.name}": figure
        for case, runs in cases.items()
        for quantity in QUANTITIES
        if (figure := plot(quantity, runs, entries)) is not None
    }
    if not cases:
        return Drawings(figures, None, "")
    try:
        return Drawings(figures, animation(cases, entries), "")
    except ParameterError as error:
        return Drawings(figures, None, str(error))


def section(name: str, heading: str, content: Any) -> Section:
    """A section with the template of its name."""
    return Section(name, heading, f"reports/templates/{name}.html", content)


def case_name(case: str) -> str:
    """Name of a case in headings."""
    return CASES.get(case, case)


def extents(metrics: Mapping[Any, Mapping[str, Any]]) -> str:
    """How many runs there are, how long they are, and with which clock."""
    parts = []
    for extent, runs in groupby(_extent(each) for each in metrics.values()):
        count = len(list(runs))
        parts.append(f"{count} {'run' if count == 1 else 'runs'} of {extent}")
    return "; ".join(parts)


def _extent(metrics: Mapping[str, Any]) -> str:
    clock = f", {metrics['clock']} clock" if metrics["clock"] else ", without ROS"
    return f"{metrics['duration']:g} s, {metrics['samples']} samples{clock}"


def happened_section(metrics: Mapping[str, Mapping[str, Any]]) -> Section:
    """Everything unusual in runs, by their names; the name of a single run is not shown."""
    content = [
        {"run": name if len(metrics) > 1 else "", "sentences": sentences}
        for name, each in metrics.items()
        if (sentences := what_happened(each))
    ]
    return section("happened", "What happened", content)


def arm_section(cases: Cases, entries: Mapping[str, Entry], drawings: Drawings, choice: str = "Law") -> Section:
    """The animation with its choices.

    Args:
        cases: the runs.
        entries: legend.
        drawings: of these runs.
        choice: what is chosen besides the case.
    """
    shown = dict.fromkeys(key for runs in cases.values() for key in runs)
    content = {
        "reason": drawings.reason,
        "grid": f"{drawings.arm['grid']:g}" if drawings.arm else "",
        "cases": {case: case_name(case) for case in cases},
        "choice": choice,
        "laws": {key: entries[key].label for key in shown},
    }
    return section("arm", "The arm", content if cases else None)


def plots_section(cases: Cases, entries: Mapping[str, Entry], drawings: Drawings, legend: str = "Laws") -> Section:
    """The boxes of the legend, if it has several entries, and the plots by case.

    Args:
        cases: the runs.
        entries: legend.
        drawings: of these runs.
        legend: what the entries are.
    """
    boxes = [{"value": key, "colour": colour(entry.style), "label": entry.label} for key, entry in entries.items()]
    figures = drawings.figures
    content = {
        "legend": f"{legend} shown",
        "boxes": boxes if len(boxes) > 1 else [],
        "cases": [
            {
                "id": case,
                "name": case_name(case),
                "plots": [
                    {
                        "id": f"{case}-{quantity.name}",
                        "title": f"{case_name(case)}: {quantity.title}",
                        "height": figures[f"{case}-{quantity.name}"].layout.height,
                        "logarithmic": quantity.magnitude,
                    }
                    for quantity in QUANTITIES
                    if f"{case}-{quantity.name}" in figures
                ],
            }
            for case in cases
        ],
    }
    return section("plots", "Plots", content if cases else None)


def metrics_table(case: str, runs: Mapping[str, Run], entries: Mapping[str, Entry], compared: bool) -> dict[str, Any]:
    """A table with one line per metric and joint, and one cell per run.

    Args:
        case: of these runs.
        runs: by law or name, at least one.
        entries: legend.
        compared: whether cells show the difference to the first run.
    """
    first = next(iter(runs.values()))[0]
    every = [metrics for _, metrics in runs.values()]
    position, effort = (either(units) for units in zip(*first.units, strict=True))
    rows = [
        {
            "metric": name.format(position=position, effort=effort),
            "joints": [
                {
                    "name": joint,
                    "unit": unit.format(**units._asdict()),
                    "cells": _cells(every, key, j, factor, compared),
                }
                for j, (joint, units) in enumerate(zip(first.joints, first.units, strict=True))
            ],
        }
        for key, name, unit, factor in _METRICS
        if any(key in metrics for metrics in every)
    ]
    caption = f"{case_name(case)}: metrics (–: not within the run)"
    return {"caption": caption, "laws": [entries[key].label for key in runs], "rows": rows}


def _cells(every: list[Mapping[str, Any]], key: str, joint: int, factor: float, compared: bool) -> list[dict[str, str]]:
    """Texts of a metric of every run, and of its difference to the first run."""
    first = metric_value(every[0], key, joint)
    differences = [difference_text(first, metric_value(metrics, key, joint)) for metrics in every[1:]]
    return [
        {"value": metric_text(metrics, key, joint, factor), "difference": difference if compared else ""}
        for metrics, difference in zip(every, ["", *differences], strict=True)
    ]


def metric_value(metrics: Mapping[str, Any], key: str, joint: int) -> float | None:
    """A metric of a joint; None if it does not exist, or if the run ran away and it would mislead."""
    if key not in metrics or (metrics["outcome"] == RAN_AWAY and key in OF_TRACKING):
        return None
    value: float | None = metrics[key][joint]
    return value


def metric_text(metrics: Mapping[str, Any], key: str, joint: int, factor: float) -> str:
    """A metric of a joint for a table, times a factor."""
    if metrics["outcome"] == RAN_AWAY and key in OF_TRACKING:
        return RAN_AWAY
    value = metric_value(metrics, key, joint)
    return value_text(value if value is None or factor == 1.0 else factor * value)
