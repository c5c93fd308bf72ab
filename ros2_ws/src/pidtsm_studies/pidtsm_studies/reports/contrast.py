"""What differs between runs, the largest first, and what is equal."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pidtsm_core.recording.metric import METRICS, RMSE, Metric
from pidtsm_core.recording.outcome import FOLLOWED, is_rough
from pidtsm_core.written import THIN, Scale, number, scale, scaled
from pidtsm_studies.reports.matrix import cell, difference, units_of, values_of
from pidtsm_studies.reports.page import BAD, GOOD, PLAIN, Answer, Section

BEST = "Which follows best?"
_THE_SAME = 1e-9
"""Relative difference of two ratios that are the same but for rounding."""
_RANKED = 4
"""Largest number of runs in the answer to `BEST`."""
_IN_A_LINE, _SHOWN = 3, 6
"""Largest number of differences in a line, and in the table."""
_REASONS = 2
"""Largest number of runs whose reason is in an answer."""
_LONGEST = 30
"""Characters of a value in an answer."""
_Metrics = Mapping[str, Mapping[str, Any]]
"""Metrics by name of the run."""


@dataclass(frozen=True)
class Contrast:
    """Where a metric differs most.

    Attributes:
        metric: the metric.
        joint: index of the joint.
        ratio: largest value of a run divided by the smallest; inf if that is 0.
    """

    metric: Metric
    joint: int
    ratio: float


@dataclass(frozen=True)
class Contrasts:
    """What differs and what does not.

    Attributes:
        found: one for each metric that differs, the largest ratio first; metrics whose ratio shows nothing new, such as
            an effort variation per second beside that per sample, are left out.
        equal: names of the metrics that are the same for every joint of every run.
        joint: the joint whose RMSE differs most, for the curves.
    """

    found: tuple[Contrast, ...]
    equal: tuple[str, ...]
    joint: int


def contrasts(metrics: _Metrics) -> Contrasts:
    """Compare runs.

    Args:
        metrics: of at least two runs of the same joints.
    """
    found: list[Contrast] = []
    equal, joint = list[str](), 0
    for metric in METRICS:
        if not all(metric.key in each for each in metrics.values()):
            continue
        columns = list(zip(*(values_of(each, metric) for each in metrics.values()), strict=True))
        if all(len(set(column)) == 1 for column in columns):
            equal.append(metric.name)
            continue
        ratios = [_ratio(column) for column in columns]
        place = max(range(len(ratios)), key=lambda j: (ratios[j], max(value or 0.0 for value in columns[j])))
        if metric is RMSE:
            joint = max(range(len(columns)), key=lambda j: _spread(columns[j]))
            place = joint
        known = any(each.joint == place and abs(each.ratio / ratios[place] - 1.0) < _THE_SAME for each in found)
        if ratios[place] > 1.0 and not known:
            found.append(Contrast(metric, place, ratios[place]))
    found.sort(key=lambda each: (each.metric is not RMSE, not each.metric.judged, -each.ratio))
    return Contrasts(tuple(found), tuple(equal), joint)


def contrast_verdict(found: Contrasts, metrics: _Metrics) -> tuple[str, str]:
    """The comparison in a sentence, and its state."""
    lost = [name for name, each in metrics.items() if each["outcome"] != FOLLOWED]
    if not found.found:
        return "The runs are equal in every metric of every joint.", BAD if lost else GOOD
    missing = f"; {', '.join(lost)} did not follow" if lost else ""
    ranked = _ranked(metrics, found.joint)
    if len(ranked) < 2:
        return f"{len(metrics) - len(lost)} of {len(metrics)} runs followed{missing}.", PLAIN
    (least, best), (most, worst) = ranked[0], ranked[-1]
    if least == most:
        return f"The runs differ, but not in the RMSE of any joint{missing}.", PLAIN
    each = next(iter(metrics.values()))
    unit, joint = units_of(each)[found.joint].position, each["joints"][found.joint]
    shown = scale([least, most], unit)
    values = f"{scaled(least, shown)} against {scaled(most, shown)}{THIN}{shown.unit}"
    by = difference(most, least, shown)
    how = "more" if len(ranked) == 2 else "most"
    return f"{best} follows {how} closely: the RMSE of {joint} is {values} of {worst} ({by}){missing}.", PLAIN


def contrast_answers(
    found: Contrasts,
    metrics: _Metrics,
    parameters: Mapping[str, Mapping[str, Any]],
    reasons: Mapping[str, str],
) -> list[Answer]:
    """The answers of a comparison.

    Args:
        found: see `contrasts`.
        metrics: by run.
        parameters: those that differ, with their values by run.
        reasons: why runs have not followed, by run.
    """
    followed = [name for name, each in metrics.items() if each["outcome"] == FOLLOWED]
    rough = [name for name in followed if is_rough(metrics[name])]
    state = BAD if len(followed) < len(metrics) else PLAIN if rough else GOOD
    joints = next(iter(metrics.values()))["joints"]
    lost = [f"{name}: {reasons[name]}" for name, each in metrics.items() if each["outcome"] != FOLLOWED]
    detail = " ".join(lost[:_REASONS]) + (f" And {len(lost) - _REASONS} more." if len(lost) > _REASONS else "")
    some = f", {len(rough)} of them roughly" if rough else ""
    answers = [Answer("Did they follow?", f"{len(followed)} of {len(metrics)}{some}", detail, state)]
    ranked = _ranked(metrics, found.joint)
    if ranked and found.found:
        unit = units_of(next(iter(metrics.values())))[found.joint].position
        shown = scale([value for value, _ in ranked], unit)
        text = ", ".join(f"{name} {scaled(value, shown)}" for value, name in ranked[:_RANKED])
        more = ", …" if len(ranked) > _RANKED else ""
        answers.append(Answer(BEST, ranked[0][1], f"RMSE of {joints[found.joint]} in {shown.unit}: {text}{more}"))
    answers.append(_changed(parameters))
    if found.found:
        answers.append(Answer("Which joint differs most?", joints[found.joint], "by its RMSE; its curves are shown"))
    return answers


def _changed(parameters: Mapping[str, Mapping[str, Any]]) -> Answer:
    """Which parameters differ: one with its values, more by their number and names."""
    question = "What was changed?"
    if not parameters:
        return Answer(question, "No parameter that is known")
    (name, values), *others = parameters.items()
    if others:
        names = ", ".join(each.partition(".")[2] for each in list(parameters)[:_RANKED])
        return Answer(question, f"{len(parameters)} parameters", names + (", …" if len(parameters) > _RANKED else ""))
    shown = [_short(value) for value in values.values()]
    some = shown if len(shown) <= _RANKED else [shown[0], "…", shown[-1]]
    return Answer(question, name.partition(".")[2], " → ".join(some) if len(shown) == 2 else ", ".join(some))


def _short(value: Any) -> str:
    """A value of a parameter in a few characters."""
    if isinstance(value, float):
        return number(value)
    text = str(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def apart_section(found: Contrasts, metrics: _Metrics) -> Section:
    """Where the runs differ most, and what is equal, in a line: of two runs the difference, of more the range."""
    first = next(iter(metrics.values()))
    shown = []
    for each in found.found[:_IN_A_LINE]:
        values = [values_of(of_run, each.metric)[each.joint] for of_run in metrics.values()]
        known = [value for value in values if value is not None]
        of = scale_of(each, first, values)
        ends = f"{scaled(min(known), of)} to {scaled(max(known), of)}{THIN}{of.unit}".rstrip(THIN)
        text = difference(values[0], values[1], of) if len(values) == 2 else ends
        unit = f"{THIN}{of.unit}" if values[0] == 0.0 and len(values) == 2 else ""
        shown.append(
            {"head": f"{each.metric.name} of {first['joints'][each.joint]}", "text": f"{text}{unit}", "title": ends}
        )
    content = {"found": shown, "more": max(0, len(found.found) - len(shown)), "equal": ", ".join(found.equal)}
    return Section("apart", "What differs:", "reports/templates/apart.html", content if shown else None)


def scale_of(each: Contrast, metrics: Mapping[str, Any], values: Sequence[float | None]) -> Scale:
    """A common scale for the values of a metric of a joint."""
    unit = each.metric.unit_of(units_of(metrics)[each.joint])
    return scale(values, unit) if each.metric.factor == 1.0 else Scale(unit, each.metric.factor)


def contrast_section(found: Contrasts, metrics: _Metrics, parameters: Mapping[str, Any]) -> Section:
    """What differs: metrics with signed differences, and parameters; equal things are one line."""
    first = next(iter(metrics.values()))
    rows = []
    for each in found.found[:_SHOWN]:
        values = [values_of(of_run, each.metric)[each.joint] for of_run in metrics.values()]
        shown = scale_of(each, first, values)
        cells = [cell(of_run, each.metric, each.joint, shown, False) for of_run in metrics.values()]
        for other, value in zip(cells[1:], values[1:], strict=True):
            other["difference"] = difference(values[0], value, shown)
        head = f"{each.metric.name} of {first['joints'][each.joint]}"
        rows.append({"head": head, "about": "", "unit": shown.unit, "cells": cells})
    table = {
        "caption": "Where the metrics differ most",
        "corner": "metric",
        "joints": [{"name": name, "note": ""} for name in metrics],
        "rows": rows,
    }
    content = {"table": table if rows else None, "equal": ", ".join(found.equal), "parameters": parameters}
    return Section("differs", "Differences in numbers", "reports/templates/differs.html", content)


def _ranked(metrics: _Metrics, joint: int) -> list[tuple[float, str]]:
    """RMSE of a joint and name of each run that followed, the best first."""
    pairs = [(values_of(each, RMSE)[joint], name) for name, each in metrics.items() if each["outcome"] == FOLLOWED]
    return sorted((value, name) for value, name in pairs if value is not None)


def _ratio(values: tuple[float | None, ...]) -> float:
    known = [abs(value) for value in values if value is not None]
    if len(known) < 2 or max(known) == 0.0:
        return 1.0
    return max(known) / min(known) if min(known) else float("inf")


def _spread(values: tuple[float | None, ...]) -> float:
    known = [value for value in values if value is not None]
    return max(known) - min(known) if known else 0.0
