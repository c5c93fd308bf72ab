"""Metrics as matrices: metrics by joints for one run, runs by joints for several."""

from collections.abc import Mapping, Sequence
from typing import Any

from pidtsm_core.recording.metric import METRICS, Metric
from pidtsm_core.recording.outcome import OF_TRACKING, RAN_AWAY
from pidtsm_core.units import JointUnits, either, joint_units
from pidtsm_core.written import NOTHING, THIN, Scale, number, scale, signed
from pidtsm_studies.reports.labels import value_text

_MUCH_SMALLER = 0.05
"""Ratio below which a percentage says too little."""


def metric_value(metrics: Mapping[str, Any], key: str, joint: int) -> float | None:
    """A metric of a joint; None if it does not exist, or if the run ran away and it would mislead."""
    if key not in metrics or (metrics["outcome"] == RAN_AWAY and key in OF_TRACKING):
        return None
    value: float | None = metrics[key][joint]
    return value


def metric_text(metrics: Mapping[str, Any], key: str, joint: int, factor: float) -> str:
    """A metric of a joint for a table of the terminal, times a factor."""
    if metrics["outcome"] == RAN_AWAY and key in OF_TRACKING:
        return RAN_AWAY
    value = metric_value(metrics, key, joint)
    return value_text(value if value is None or factor == 1.0 else factor * value)


def values_of(metrics: Mapping[str, Any], metric: Metric) -> list[float | None]:
    """A metric of every joint; see `metric_value`."""
    return [metric_value(metrics, metric.key, joint) for joint in range(len(metrics["joints"]))]


def units_of(metrics: Mapping[str, Any]) -> tuple[JointUnits, ...]:
    """Units of the joints of a run."""
    return joint_units(metrics["slides"], len(metrics["joints"]))


def worst(values: Sequence[float | None], units: Sequence[str]) -> int | None:
    """Index of the largest value among those with the most common unit; None if there are not two, or all are alike."""
    common = max(dict.fromkeys(units), key=list(units).count)
    known = {i: v for i, (v, unit) in enumerate(zip(values, units, strict=True)) if v is not None and unit == common}
    if len(known) < 2 or len(set(known.values())) < 2:
        return None
    return max(known, key=lambda index: known[index])


def of_joints(metrics: Mapping[str, Any], caption: str) -> dict[str, Any]:
    """The matrix of one run: a row per metric, a column per joint."""
    units = units_of(metrics)
    rows = []
    for metric in METRICS:
        if metric.key not in metrics:
            continue
        values, si = values_of(metrics, metric), [metric.unit_of(each) for each in units]
        scales = _scales(metric, [values], si)
        place = worst(values, si) if metric.judged else None
        rows.append(
            {
                "head": metric.name,
                "about": _about(metric, units),
                "unit": _unit_text(scales),
                "cells": [
                    cell(metrics, metric, joint, scales[si[joint]], joint == place) for joint in range(len(values))
                ],
            }
        )
    return {"caption": caption, "corner": "metric", "joints": _heads(metrics), "rows": rows}


def of_runs(runs: Mapping[str, Mapping[str, Any]], metric: Metric, labels: Mapping[str, str]) -> dict[str, Any]:
    """The matrix of a metric of several runs: a row per run, a column per joint, with differences to the first run.

    Args:
        runs: metrics by key of the run, of the same joints.
        metric: one that a run has.
        labels: names of the runs.
    """
    first = next(iter(runs.values()))
    units = units_of(first)
    si = [metric.unit_of(each) for each in units]
    every = {key: values_of(metrics, metric) for key, metrics in runs.items()}
    scales = _scales(metric, list(every.values()), si)
    flat = [value for values in every.values() for value in values]
    place = worst(flat, si * len(every)) if metric.judged else None
    before = next(iter(every.values()))
    rows = []
    for number_of_row, (key, metrics) in enumerate(runs.items()):
        cells = []
        for joint in range(len(units)):
            marked = place == number_of_row * len(units) + joint
            found = cell(metrics, metric, joint, scales[si[joint]], marked)
            if number_of_row:
                found["difference"] = difference(before[joint], every[key][joint], scales[si[joint]])
            cells.append(found)
        rows.append({"head": labels[key], "about": "", "unit": "", "cells": cells})
    caption = f"{metric.name} ({_about(metric, units)}){f', {_unit_text(scales)}' if _unit_text(scales) else ''}"
    return {"caption": caption, "corner": "run", "joints": _heads(first), "rows": rows}


def cell(metrics: Mapping[str, Any], metric: Metric, joint: int, shown: Scale, marked: bool) -> dict[str, Any]:
    """A cell: text; value in the unit of metrics.json and its unit, for the pointer; and whether it is the worst."""
    value = metric_value(metrics, metric.key, joint)
    if value is None:
        lost = metrics["outcome"] == RAN_AWAY and metric.key in OF_TRACKING
        missing = RAN_AWAY if lost else "not within the run"
        return {
            "text": RAN_AWAY if lost else NOTHING,
            "value": None,
            "title": missing,
            "worst": False,
            "difference": "",
        }
    whole = f"{value!r} {metric.unit_of(units_of(metrics)[joint])}".strip() if metric.factor == 1.0 else f"{value!r}"
    return {
        "text": number(value if isinstance(value, int) else shown.factor * value),
        "value": repr(value),
        "title": whole,
        "worst": marked,
        "key": metric.key,
        "joint": joint,
        "difference": "",
    }


def difference(first: float | None, value: float | None, shown: Scale) -> str:
    """How a value differs from the first one: relative to it, or by how much if it is 0; empty without either."""
    if first is None or value is None:
        return ""
    if value == first:
        return "="
    if first == 0.0:
        return signed(shown.factor * value, digits=2)
    ratio = value / first
    if 0.0 < ratio < _MUCH_SMALLER:
        return f"{number(first / value, digits=2)}{THIN}× smaller"
    percent = 100.0 * (ratio - 1.0)
    return f"{signed(percent, digits=2)}{THIN}%" if abs(percent) < 1000.0 else f"{number(ratio, digits=2)}{THIN}×"


def _scales(metric: Metric, rows: Sequence[Sequence[float | None]], units: Sequence[str]) -> dict[str, Scale]:
    """A common scale for the values of each unit."""
    found = {}
    for unit in dict.fromkeys(units):
        values = [value for row in rows for value, its in zip(row, units, strict=True) if its == unit]
        found[unit] = Scale(unit, metric.factor) if metric.factor != 1.0 else scale(values, unit)
    return found


def _unit_text(scales: Mapping[str, Scale]) -> str:
    return either(each.unit for each in scales.values() if each.unit)


def _about(metric: Metric, units: Sequence[JointUnits]) -> str:
    position, effort = (either(each) for each in zip(*units, strict=True))
    return metric.about.format(position=position, effort=effort)


def _heads(metrics: Mapping[str, Any]) -> list[dict[str, str]]:
    mixed = len(set(metrics["slides"])) > 1
    return [
        {"name": joint, "note": "slides" if mixed and slides else ""}
        for joint, slides in zip(metrics["joints"], metrics["slides"], strict=True)
    ]
