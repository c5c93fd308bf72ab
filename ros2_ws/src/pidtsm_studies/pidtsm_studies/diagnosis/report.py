"""The page of a diagnosis: what is wrong, with its evidence and its cure, and what is fine."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.written import number
from pidtsm_studies.diagnosis.causes import NAMES
from pidtsm_studies.diagnosis.diagnose import Diagnosis
from pidtsm_studies.diagnosis.verdict import Plot, State, Verdict
from pidtsm_studies.reports.charts import Axis, Line, chart
from pidtsm_studies.reports.page import BAD, GOOD, PLAIN, Answer, Page, Section, write_page

_POINTS = 1500
"""Most points of a curve: the smallest and the largest of every few samples."""
_STATES = {State.FOUND: "found", State.FINE: "fine", State.UNKNOWN: "not shown by this recording"}


def write_diagnosis_report(
    path: Path, diagnosis: Diagnosis, source: str, truth: Sequence[Mapping[str, Any]] | None = None
) -> None:
    """Write the page; the same diagnosis gives the same file.

    Args:
        path: the HTML file; an existing one is replaced.
        diagnosis: the verdicts.
        source: of the recording, for the title.
        truth: what a blind arm has, see `blind.seal`; empty: nothing; None: it is not known.
    """
    charts: dict[str, Any] = {}
    shown = [_shown(each, charts) for each in diagnosis.found]
    fine = [_shown(each, charts) for each in diagnosis.verdicts if not each.found]
    sections = (
        _section("found", "What is wrong", shown),
        _section("fine", "What else was looked for", fine, folded=True),
        _section("truth", "The truth", None if truth is None else {"faults": list(truth)}, folded=True),
    )
    state = GOOD if diagnosis.is_good else BAD
    title, summary = f"Diagnosis of {source}", _summary(diagnosis)
    write_page(path, Page(title, sentence(diagnosis), state, summary, _answers(diagnosis), sections, None, charts))


def sentence(diagnosis: Diagnosis) -> str:
    """What the diagnosis says, in one sentence."""
    stop = f" The controller stopped: {diagnosis.stopped}." if diagnosis.stopped else ""
    if not diagnosis.found:
        missing = sum(each.state is State.UNKNOWN for each in diagnosis.verdicts)
        but = f", but {missing} causes could not be judged" if missing else ""
        return f"{'Nothing was found' if stop else 'This run is good: nothing was found'}{but}.{stop}"
    return f"Found: {', '.join(NAMES[each.cause] for each in diagnosis.found)}.{stop}"


def _summary(diagnosis: Diagnosis) -> str:
    joints = len(diagnosis.joints)
    return f"{number(diagnosis.duration)} s of {joints} joints at {number(diagnosis.rate)} Hz were judged"


def _answers(diagnosis: Diagnosis) -> list[Answer]:
    found = diagnosis.found
    unknown = [NAMES[each.cause] for each in diagnosis.verdicts if each.state is State.UNKNOWN]
    answers = [
        Answer(
            "Is this run good?",
            "Yes" if diagnosis.is_good else "No",
            "" if diagnosis.is_good else sentence(diagnosis),
            GOOD if diagnosis.is_good else BAD,
        )
    ]
    if found:
        joints = ", ".join(dict.fromkeys(joint for each in found for joint in each.joints[:2]))
        answers.append(Answer("Which joints?", joints or "the whole arm", found[0].text, BAD))
        answers.append(Answer("What to do first?", NAMES[found[0].cause], found[0].cure))
    count = f"{len(unknown)} causes" if unknown else "Nothing"
    return [*answers, Answer("What could not be judged?", count, ", ".join(unknown), PLAIN)]


def _shown(verdict: Verdict, charts: dict[str, Any]) -> dict[str, Any]:
    """A verdict for the template; its plots are added to the charts of the page."""
    plots = []
    for i, plot in enumerate(verdict.plots):
        key = f"{verdict.cause.value}-{i}"
        charts[key] = _chart(plot)
        plots.append({"id": key, "title": plot.title, "chart": charts[key]})
    return {
        "name": NAMES[verdict.cause],
        "state": _STATES[verdict.state],
        "joints": ", ".join(verdict.joints),
        "text": verdict.text,
        "cure": verdict.cure,
        "plots": plots,
    }


def _chart(plot: Plot) -> dict[str, Any]:
    lines = []
    for style, curve in enumerate(plot.curves):
        x, y = _fewer(curve.x, curve.y)
        if plot.logarithmic:
            y = np.where(y > 0.0, y, np.nan)
        lines.append(Line(curve.label, style, x, y, points=4 if curve.points else 0))
    return chart(lines, Axis(plot.x_label, plot.logarithmic), Axis(plot.y_label, plot.logarithmic))


def _fewer(x: Array, y: Array) -> tuple[Array, Array]:
    """The smallest and the largest of every few points."""
    block = -(-len(x) // (_POINTS // 2))
    if block <= 2:
        return x, y
    rows = []
    for begin in range(0, len(x), block):
        part = np.nan_to_num(y[begin : begin + block])
        rows += sorted({begin + int(part.argmin()), begin + int(part.argmax())})
    return x[rows], y[rows]


def _section(name: str, heading: str, content: Any, folded: bool = False) -> Section:
    template = "verdicts" if name in ("found", "fine") else name
    return Section(name, heading, f"diagnosis/templates/{template}.html", content, folded)
