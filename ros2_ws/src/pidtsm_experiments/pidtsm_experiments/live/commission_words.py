"""A commissioning in words, as HTML."""

from collections.abc import Mapping
from html import escape
from pathlib import Path

from pidtsm_experiments.commissioning.consent import HEADINGS, QUESTION, heading
from pidtsm_experiments.commissioning.guided import Asked
from pidtsm_experiments.live.guide import Guide
from pidtsm_experiments.live.words import AMBER, GREEN, GREY, RED
from pidtsm_studies.commissioning.result import REPORT
from pidtsm_studies.commissioning.session import NAMES, TITLES, Session

_INTRODUCTION = (
    "From the description of this arm to gains measured on it, in eight steps. Before each step you see what will "
    "move, how far and with how much torque, and agree. The controller gives way; a process of its own moves and "
    "holds the arm, also between the steps and if this page is closed."
)
_STYLE = "padding:0 0.75em 0.5em;font-size:0.85em;overflow-wrap:anywhere"
_FRAME = "width:100%;height:34em;border:1px solid #ced4da;border-radius:4px;background:white"


def text_of(guide: Guide, held: bool) -> str:
    """What a session does or waits for, and what it has just found."""
    if guide.asked is not None:
        content = _step(guide.asked, waits=guide.since is None)
    elif guide.runs:
        content = _line("The arm is being found", AMBER)
    elif guide.ended:
        content = _line(guide.ended, RED) + _held(held)
    elif guide.session is None or not guide.session.found:
        content = f"<p>{_INTRODUCTION}</p>"
    elif guide.session.missing:
        content = _line(f"{len(guide.session.missing)} steps are left", AMBER) + _held(held)
    else:
        verdict = str(guide.session.found[NAMES[-1]]["verdict"])
        content = _line(f"All steps are done: {verdict}", GREEN) + _held(held)
    said = "".join(f"<div>{escape(each)}</div>" for each in guide.said)
    return f'<div id="commission" style="{_STYLE}">{content}<div id="said">{said}</div></div>'


def _step(asked: Asked, waits: bool) -> str:
    head = "".join(f'<th style="text-align:left">{each}</th>' for each in HEADINGS)
    rows = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in asked.rows)
    doubt = f"<p><b>{QUESTION}</b></p>" if waits else ""
    return (
        f"{_line(f'{heading(asked.step)}, {asked.duration:.0f} s', AMBER if waits else GREEN)}"
        f'<p>{escape(asked.text)}</p><table style="width:100%;font-size:0.95em"><tr>{head}</tr>{rows}</table>{doubt}'
    )


def _line(text: str, color: str) -> str:
    return f'<div style="color:{color};font-weight:600">{escape(text)}</div>'


def _held(held: bool) -> str:
    return "<div>The arm is held.</div>" if held else ""


def steps(session: Session | None, now: str) -> str:
    """What each step has found so far; `now`: the one that runs or waits for consent."""
    if session is None:
        return ""
    lines = []
    for name in NAMES:
        found = session.found.get(name)
        color = GREY if found is None else RED if found["problems"] else GREEN
        sign = "●" if found is not None else "▶" if name == now else "○"
        text = f": {escape(str(found['verdict']))}" if found is not None else ""
        looks = "".join(f"<div>look: {escape(str(each))}</div>" for each in found["problems"]) if found else ""
        lines.append(
            f'<div id="step-{name}"><span style="color:{color}">{sign}</span> <b>{TITLES[name]}</b>{text}{looks}</div>'
        )
    return f'<div id="steps" style="{_STYLE}">{"".join(lines)}</div>'


def report_frame(files: Mapping[str, Path]) -> str:
    """The report with its plots, and links to all files of the result, by their addresses below that of the page."""
    links = " · ".join(
        f'<a href="{escape(place)}" target="_blank" style="text-decoration:underline">{escape(file.name)}</a>'
        for place, file in files.items()
    )
    frames = "".join(
        f'<iframe src="{escape(place)}?{file.stat().st_mtime_ns}" title="report" style="{_FRAME}"></iframe>'
        for place, file in files.items()
        if file.name == REPORT
    )
    return f'<div id="report" style="{_STYLE}">{links}{frames}</div>' if files else ""
