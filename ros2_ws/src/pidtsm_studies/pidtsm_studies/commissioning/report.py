"""The page of a commissioning: for each step what was found, with plots, and what a person should look at."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.written import number
from pidtsm_studies.commissioning.compare import NEW, OLD
from pidtsm_studies.commissioning.loop import Samples
from pidtsm_studies.commissioning.model import ArmModel
from pidtsm_studies.commissioning.result import REPORT, chosen, differences
from pidtsm_studies.commissioning.session import NAMES, TITLES, Session
from pidtsm_studies.reports.charts import Axis, Line, chart
from pidtsm_studies.reports.page import BAD, GOOD, PLAIN, Answer, Page, Section, write_page

_DRAWN = 1500
"""Points of a line at most."""
_TIME = Axis("time, s")
_WAY, _EFFORT = Axis("mrad or mm"), Axis("share of the limit")
_TEMPLATE = "commissioning/templates/step.html"


def write_report(session: Session, robot: str) -> None:
    """Write the page of what is complete so far; the same session gives the same file.

    Args:
        session: the session.
        robot: name of the arm, for the title.
    """
    model = ArmModel(session.subject.arm)
    charts: dict[str, Any] = {}
    sections = [_section(session, model, name, charts) for name in NAMES if name in session.found]
    if rows := differences(session):
        sections.append(_repeated(rows))
    if "compare" in session.found:
        sections.append(_parameters(session))
    verdict, state = _verdict(session)
    looks = [problem for each in session.found.values() for problem in each["problems"]]
    page = Page(
        f"Commissioning of {robot}",
        verdict,
        state,
        f"{len(session.found)} of {len(NAMES)} steps are done",
        _answers(session, looks),
        sections,
        charts=charts,
    )
    write_page(session.folder / REPORT, page)


def _verdict(session: Session) -> tuple[str, str]:
    if "compare" not in session.found:
        return "Not complete yet.", PLAIN
    compared = session.found["compare"]
    text = compared["verdict"]
    return f"{text[:1].upper()}{text[1:]}.", GOOD if compared["figures"]["better"] else PLAIN


def _answers(session: Session, looks: Sequence[str]) -> list[Answer]:
    """The cards; the first part of a verdict must do, the sections have the rest."""

    def told(step: str, until: str = ":") -> str:
        text = str(session.found[step]["verdict"]) if step in session.found else "not done yet"
        return text.partition(until)[0]

    late = session.found.get("springs", {}).get("figures", {}).get("delay")
    lateness = told("lateness") if late is None else f"torques act {1e3 * late:.1f} ms after the position"
    inverted = bool(session.found.get("signs", {}).get("problems"))
    return [
        Answer("Is the arm wired as described?", told("signs", "; correct"), state=BAD if inverted else PLAIN),
        Answer("How good are its signals?", told("rest"), lateness),
        Answer("Are the joints elastic?", told("springs")),
        Answer("Is the description right?", told("gravity"), told("identify")),
        Answer(
            "What to look at?",
            f"{len(looks)} thing{'s' if len(looks) != 1 else ''}" if looks else "Nothing",
            looks[0] if looks else "",
            BAD if looks else PLAIN,
        ),
    ]


def _section(session: Session, model: ArmModel, name: str, charts: dict[str, Any]) -> Section:
    """The section of a step; its charts are added to `charts`."""
    found = session.found[name]
    drawn = []
    for title, key, content in _charts(session, model, name, found):
        charts[key] = content
        drawn.append((key, title))
    caption, head, rows = _table(model, name, found["figures"])
    content = {
        "verdict": found["verdict"],
        "problems": found["problems"],
        "charts": drawn,
        "caption": caption,
        "head": head,
        "rows": rows,
    }
    return Section(name, TITLES[name], _TEMPLATE, content)


def _charts(
    session: Session, model: ArmModel, name: str, found: dict[str, Any]
) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Title, id and data of the charts of a step."""
    figures = found["figures"]
    if name == "signs":
        samples = session.samples(name)
        yield (
            "Way of each joint",
            "signs-way",
            _over_time(model, samples, 1e3 * (samples.position - samples.position[0])),
        )
    elif name == "springs" and "frequency" in figures:
        yield "Acceleration per torque: measured (points) and explained", "springs-answers", _shaking(model, figures)
    elif name == "gains":
        levels = figures["levels"]
        at = np.array([each["level"] for each in levels])
        for title, key, unit in (("Error", "error", "rad or m"), ("Roughness of the torque", "rough", "1: allowed")):
            values = np.array([each[key] for each in levels])
            lines = [Line(joint, j, at, values[:, j]) for j, joint in enumerate(model.joints)]
            yield title, f"gains-{key}", chart(lines, Axis("bandwidth, relative to the rule"), Axis(unit))
    elif name == "compare":
        last = [each for each in (OLD, NEW) if any(key.startswith(each) for key in found["samples"])]
        for each in last:
            key = [key for key in found["samples"] if key.startswith(each)][-1]
            moved = session.samples(key).motion
            error = 1e3 * (moved.position - moved.desired[:, 0])
            yield f"Error, {each}", f"compare-{each}", _over_time(model, moved, error)
    elif found["samples"]:
        moved = session.samples(found["samples"][0]).motion
        yield "Torque", f"{name}-effort", _over_time(model, moved, moved.effort / model.effort, _EFFORT)
        error = 1e3 * (moved.position - moved.desired[:, 0])
        yield "Error", f"{name}-error", _over_time(model, moved, error)


def _over_time(model: ArmModel, samples: Samples, values: Array, axis: Axis = _WAY) -> dict[str, Any]:
    few = slice(None, None, max(1, len(values) // _DRAWN))
    lines = [Line(joint, j, samples.time[few], values[few, j]) for j, joint in enumerate(model.joints)]
    return chart(lines, _TIME, axis)


def _shaking(model: ArmModel, figures: dict[str, Any]) -> dict[str, Any]:
    """What was measured as points, and what explains it as lines, over the frequency."""
    frequency, shaken, measured, explained = (
        np.array(figures[name]) for name in ("frequency", "joint", "measured", "explained")
    )
    lines = []
    for j in np.unique(shaken).tolist():
        of_joint = np.flatnonzero(shaken == j)
        rows = of_joint[np.argsort(frequency[of_joint], kind="stable")]
        lines.append(Line("", j, frequency[rows], measured[rows], _POINTS))
        lines.append(Line(model.joints[j], j, frequency[rows], explained[rows]))
    return chart(lines, Axis("frequency, Hz", logarithmic=True), Axis("1/(kg m^2)", logarithmic=True))


_POINTS = 4
"""px."""
_COLUMNS = {
    "signs": {"position": "position", "effort": "torque", "moved": "moved at most", "known_by": "known by"},
    "rest": {"noise": "noise", "step": "step"},
    "lateness": {"of_joints": "late by, s"},
    "friction": {"coulomb": "Coulomb", "half_interval": "±", "viscous": "viscous", "breakaway": "breaks away at"},
    "gravity": {
        "share": "missing share",
        "share_deviation": "its deviation",
        "zero": "zero offset",
        "zero_deviation": "its deviation",
    },
    "springs": {"resonance": "rotor swings at, Hz", "stiffness": "stiffness", "damping": "damping", "rotor": "rotor"},
    "identify": {"before": "torque error described", "after": "identified"},
    "gains": {"bandwidth": "bandwidth of the observer"},
}
"""Figures of each step that have a number for each joint, and their headings, in SI units."""


def _table(model: ArmModel, name: str, figures: dict[str, Any]) -> tuple[str, list[str], list[list[str]]]:
    """Caption, headings and rows of the figures of a step."""
    columns = {key: text for key, text in _COLUMNS.get(name, {}).items() if key in figures}
    if not columns:
        return "", [], []
    rows = [[joint, *(_text(figures[key][j]) for key in columns)] for j, joint in enumerate(model.joints)]
    return "By joint, in SI units", ["joint", *columns.values()], rows


def _text(value: Any) -> str:
    if value is None:
        return "not known"
    return value if isinstance(value, str) else number(float(value))


def _parameters(session: Session) -> Section:
    rows = [[name, _short(value), reason] for name, (value, reason) in chosen(session, "").items()]
    content = {
        "verdict": "These are in commission.yaml, for the nodes and for --params.",
        "problems": [],
        "charts": [],
        "caption": "Parameters of the controller",
        "head": ["parameter", "value", "reason"],
        "rows": rows,
    }
    return Section("parameters", "Parameters", _TEMPLATE, content, folded=True)


def _short(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return ", ".join(_short(each) for each in value)
    text = number(value) if isinstance(value, float) else str(value)
    return text if len(text) < 80 else f"{text[:60]}…"


def _repeated(rows: Sequence[tuple[str, str, float, float]]) -> Section:
    content = {
        "verdict": "What a step found the time before, and now: wear, temperature or another load.",
        "problems": [],
        "charts": [],
        "caption": "Before and now, in SI units",
        "head": ["joint", "what", "before", "now"],
        "rows": [[joint, text, number(before), number(now)] for text, joint, before, now in rows],
    }
    return Section("repeated", "Against the time before", _TEMPLATE, content)
