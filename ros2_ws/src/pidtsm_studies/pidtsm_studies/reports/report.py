"""The report of a run or a reproduction: content of its sections as plain data for their templates."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, TypeAlias

from pidtsm_core.outcome import OF_TRACKING, RAN_AWAY, what_happened
from pidtsm_core.parameters import ParameterError
from pidtsm_core.recording import Recording
from pidtsm_core.units import either
from pidtsm_studies.article.claims import Comparison, Reproduction, Run
from pidtsm_studies.reports.animation import animation
from pidtsm_studies.reports.labels import CASES, label, style_indices, value_text
from pidtsm_studies.reports.page import Section, write_page
from pidtsm_studies.reports.plots import QUANTITIES, colour, plot

_Cases: TypeAlias = Mapping[str, Mapping[str, Run]]
"""The finished runs, by case and law."""

# Key, name, unit and factor. In a name, {position} and {effort} are the units of all joints, in a unit those of one.
_METRICS = (
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


def write_report(
    path: Path,
    runs: Reproduction | Run,
    comparisons: Sequence[Comparison] = (),
    notes: Sequence[str] = (),
) -> None:
    """Write the report; the same runs give the same file.

    The arm is animated if the descriptions of all arms can be read; otherwise a sentence gives the reason.

    Args:
        path: the HTML file.
        runs: a reproduction, or a single run.
        comparisons: comparisons with the article, as returned by `claims.compare`; empty: a report without the article.
        notes: further notes on the deviations, each a sentence or a paragraph.
    """
    reproduction = {_key(runs[0]): runs} if isinstance(runs, tuple) else runs
    done = {key: run for key, run in reproduction.items() if not isinstance(run, str)}
    failed = {key: reason for key, reason in reproduction.items() if isinstance(reason, str)}
    styles = style_indices(law for _, law in done)
    cases = {
        case: {law: done[case, law] for law in styles if (case, law) in done}
        for case in sorted({case for case, _ in done})
    }
    figures = {
        f"{case}-{quantity.name}": figure
        for case, by_law in cases.items()
        for quantity in QUANTITIES
        if (figure := plot(quantity, by_law, styles)) is not None
    }
    arm, reason = _animation(cases, styles)
    sections = (
        _section("happened", "What happened", _happenings(done)),
        _section("arm", "The arm", _arm(cases, arm, reason) if cases else None),
        _section("article", "Article and project", _comparison_tables(comparisons)),
        _section("metrics", "Metrics", _metrics(cases, failed)),
        _section("plots", "Plots", _plots(cases, figures, styles) if cases else None),
        _section("deviations", "Deviations from the article, with reasons", _deviations(comparisons, notes)),
    )
    title = "The article, reproduced" if comparisons else ", ".join(_run_name(*key) for key in done)
    write_page(path, title, _summary(done, failed), sections, figures, arm)


def _section(name: str, heading: str, content: Any) -> Section:
    return Section(name, heading, f"reports/templates/{name}.html", content)


def _key(recording: Recording) -> tuple[str, str]:
    return recording.scenario or "run", recording.law or "unknown law"


def _case_name(case: str) -> str:
    return CASES.get(case, case)


def _run_name(case: str, law: str) -> str:
    return f"{_case_name(case)}, {label(law)}"


def _summary(done: Mapping[tuple[str, str], Run], failed: Collection[object]) -> str:
    """Description of the runs in one sentence; those without curves count too."""
    parts = []
    for extent, runs in groupby(_extent(metrics) for _, metrics in done.values()):
        count = len(list(runs))
        parts.append(f"{count} {'run' if count == 1 else 'runs'} of {extent}")
    if failed:
        return f"{len(done) + len(failed)} runs: {'; '.join(parts)}; {len(failed)} without curves, see Metrics"
    return "; ".join(parts)


def _extent(metrics: Mapping[str, Any]) -> str:
    clock = f", {metrics['clock']} clock" if metrics["clock"] else ", without ROS"
    return f"{metrics['duration']:g} s, {metrics['samples']} samples{clock}"


def _happenings(done: Mapping[tuple[str, str], Run]) -> list[dict[str, Any]]:
    """Everything unusual, by run; runs are named if there are several."""
    return [
        {"run": _run_name(*key) if len(done) > 1 else "", "sentences": sentences}
        for key, (_, metrics) in done.items()
        if (sentences := what_happened(metrics))
    ]


def _animation(cases: _Cases, styles: Mapping[str, int]) -> tuple[dict[str, Any] | None, str]:
    """The data of the animation, or the reason why there is none."""
    if not cases:
        return None, ""
    try:
        return animation(cases, styles), ""
    except ParameterError as error:
        return None, str(error)


def _arm(cases: _Cases, arm: Mapping[str, Any] | None, reason: str) -> dict[str, Any]:
    """Choices for the animation, and its grid."""
    laws = dict.fromkeys(law for by_law in cases.values() for law in by_law)
    return {
        "reason": reason,
        "grid": f"{arm['grid']:g}" if arm else "",
        "cases": {case: _case_name(case) for case in cases},
        "laws": {law: label(law) for law in laws},
    }


def _comparison_tables(comparisons: Sequence[Comparison]) -> list[dict[str, Any]]:
    """One table per case; neighbours that differ only in the joint form a group."""
    reasons = list(_reasons(comparisons))
    tables = []
    for case, of_case in groupby(comparisons, key=lambda each: each.claim.case):
        groups = []
        for _, alike in groupby(of_case, key=_group):
            group = list(alike)
            claim = group[0].claim
            about = f", {label(claim.laws[0])}" if len(claim.laws) == 1 else ""
            groups.append(
                {
                    "quantity": claim.quantity + about,
                    "printed_in": claim.printed_in,
                    "reason": reasons.index(claim.reason) + 1,
                    "comparisons": group,
                }
            )
        tables.append({"caption": f"{_case_name(case)}: article and project", "groups": groups})
    return tables


def _group(comparison: Comparison) -> tuple[Any, ...]:
    claim = comparison.claim
    return claim.quantity, claim.laws, claim.printed_in, claim.reason


def _reasons(comparisons: Iterable[Comparison]) -> dict[str, list[str]]:
    """The quantities of each reason, in the order of the comparisons."""
    reasons: dict[str, list[str]] = {}
    for claim in (comparison.claim for comparison in comparisons):
        quantities = reasons.setdefault(claim.reason, [])
        quantity = f"{_case_name(claim.case)}: {claim.quantity.partition(',')[0]}"
        if quantity not in quantities:
            quantities.append(quantity)
    return reasons


def _metrics(cases: _Cases, failed: Mapping[tuple[str, str], str]) -> dict[str, Any] | None:
    """The tables, and a sentence about each failed run."""
    if not (cases or failed):
        return None
    failures = [f"{_run_name(*key)}: {reason}" for key, reason in failed.items()]
    return {"tables": _metrics_tables(cases), "failures": failures}


def _metrics_tables(cases: _Cases) -> list[dict[str, Any]]:
    """One table per case, with one line per metric and joint, and one cell per law."""
    tables = []
    for case, runs in cases.items():
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
                        "cells": [_cell(metrics, key, j, factor) for metrics in every],
                    }
                    for j, (joint, units) in enumerate(zip(first.joints, first.units, strict=True))
                ],
            }
            for key, name, unit, factor in _METRICS
            if any(key in metrics for metrics in every)
        ]
        caption = f"{_case_name(case)}: metrics (–: not within the run)"
        tables.append({"caption": caption, "laws": [label(law) for law in runs], "rows": rows})
    return tables


def _cell(metrics: Mapping[str, Any], key: str, joint: int, factor: float) -> str:
    if metrics["outcome"] == RAN_AWAY and key in OF_TRACKING:
        return RAN_AWAY
    value = metrics[key][joint] if key in metrics else None
    return value_text(value if value is None or factor == 1.0 else factor * value)


def _plots(cases: _Cases, figures: Mapping[str, Any], styles: Mapping[str, int]) -> dict[str, Any]:
    """The boxes of the laws, if there are several, and the plots by case."""
    boxes = [{"value": law, "colour": colour(style), "label": label(law)} for law, style in styles.items()]
    return {
        "boxes": boxes if len(boxes) > 1 else [],
        "cases": [
            {
                "id": case,
                "name": _case_name(case),
                "plots": [
                    {
                        "id": f"{case}-{quantity.name}",
                        "title": f"{_case_name(case)}: {quantity.title}",
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


def _deviations(comparisons: Sequence[Comparison], notes: Sequence[str]) -> dict[str, Any] | None:
    if not (comparisons or notes):
        return None
    judged = [each for each in comparisons if each.holds is not None]
    false = [
        f"{_case_name(each.claim.case)}, joint {each.claim.joint + 1}: {each.claim.quantity} ({each.claim.printed()})"
        for each in judged
        if not each.holds
    ]
    return {
        "notes": notes,
        "judged": len(judged),
        "false": false,
        "reasons": _reasons(comparisons),
    }
