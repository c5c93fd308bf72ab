"""The report of a run or a reproduction: one HTML file that opens offline."""

import base64
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from pidtsm_core.outcome import OF_TRACKING, RAN_AWAY, what_happened
from pidtsm_core.parameters import Array
from pidtsm_core.recording import Recording
from pidtsm_core.signals import Signal
from pidtsm_studies.article.claims import Comparison, Reproduction, Run
from pidtsm_studies.reports.figures import COLOURS, DASHES, decimated
from pidtsm_studies.reports.labels import CASES, label, style_indices, value_text

LINKS = (1.0, 0.85)
"""Lengths of the article's two links, m."""

_PARTS = 1000  # of the time axis of which a line keeps the extremes
_ARM_RATE = 50.0  # samples a second of the animation
_LINE_WIDTH = 1.8  # pixels


@dataclass(frozen=True)
class _Quantity:
    """Something that is plotted over time, a panel a joint."""

    name: str
    title: str
    axis: str
    values: Callable[[Recording], Array]


def _signal(signal: Signal) -> Callable[[Recording], Array]:
    return lambda recording: recording.signals[:, signal]


_QUANTITIES = (
    _Quantity("tracking", "Tracking", "q (rad)", lambda recording: recording.position),
    _Quantity("error", "Tracking error", "e = q − q<sub>d</sub> (rad)", lambda recording: recording.error),
    _Quantity("torque", "Applied torque", "τ (N m)", lambda recording: recording.effort),
    _Quantity("sliding", "Sliding variable s, in the unit of the law's surface", "s", _signal(Signal.SLIDING_VARIABLE)),
    _Quantity("manifold", "Manifold variable σ, in the unit of the law", "σ", _signal(Signal.MANIFOLD_VARIABLE)),
    _Quantity("gain", "Adaptive gain Υ, in the unit of σ a second", "Υ", _signal(Signal.ADAPTIVE_GAIN)),
)

_METRICS = (
    ("rmse", "RMSE, root of the mean of e²", "rad", 1.0),
    ("eci", "ECI, mean |τ|", "N m", 1.0),
    ("steady_state_error", "steady-state error, max |e| over the last 40 % of the run", "rad", 1.0),
    ("settling_time", "settling time, until |e| stays below 2 % of its start", "s", 1.0),
    ("recovery_time", "recovery time, from the event until |e| stays below 1e-3 rad", "s", 1.0),
    ("torque_variation", "torque variation, mean change from sample to sample", "N m", 1.0),
    ("torque_variation_rate", "torque variation a second", "N m/s", 1.0),
    ("torque_jumps", "torque jumps, samples at which it changes by more than 5 N m", "", 1.0),
    ("saturation", "torque at its limit or that of its rate, share of the samples", "%", 100.0),
    ("time_at_effort_limit", "torque at its limit", "s", 1.0),
    ("time_at_rate_limit", "torque at the limit of its rate", "s", 1.0),
    ("adaptive_gain", "adaptive gain Υ at the end", "", 1.0),
)


def write_report(
    path: Path,
    runs: Reproduction | Run,
    rows: Sequence[Comparison] | None = None,
    notes: Sequence[str] = (),
    links: Sequence[float] = LINKS,
) -> None:
    """Write the report; the same runs give the same file.

    Args:
        path: the HTML file.
        runs: a reproduction, or a single run.
        rows: the comparison with the article, as `claims.compare` gives it; None without one.
        notes: what else is to be said of the deviations, a sentence or a paragraph each.
        links: lengths of the links of a planar arm, m; the arm is drawn if there are as many as joints.
    """
    reproduction = {_key(runs[0]): runs} if isinstance(runs, tuple) else runs
    done = {key: run for key, run in reproduction.items() if not isinstance(run, str)}
    failed = {key: reason for key, reason in reproduction.items() if isinstance(reason, str)}
    laws = style_indices(law for _, law in done)
    cases = {
        case: {law: done[case, law] for law in laws if (case, law) in done}
        for case in sorted({case for case, _ in done})
    }
    figures = {
        f"{case}-{quantity.name}": figure
        for case, by_law in cases.items()
        for quantity in _QUANTITIES
        if (figure := _figure(quantity, by_law, laws)) is not None
    }
    arm = _arm(cases, laws, links)
    sections = {
        "happened": ("What happened", _what_happened(done)),
        "arm": ("The arm", _arm_section(cases) if arm else ""),
        "article": ("Article and project", _comparison_table(rows) if rows else ""),
        "metrics": ("Metrics", _metrics_tables(cases, failed)),
        "plots": ("Plots", _plots(cases, figures, laws)),
        "deviations": ("What deviates from the article, and why", _deviations(rows or (), notes)),
    }
    title = "The article, reproduced" if rows else ", ".join(f"{_case(case)}, {label(law)}" for case, law in done)
    write_page(path, title, _summary(done), sections, figures, arm)


def write_page(
    path: Path,
    title: str,
    summary: str,
    sections: Mapping[str, tuple[str, str]],
    figures: Mapping[str, Any],
    arm: Mapping[str, Any] | None = None,
) -> None:
    """Write a page in the style of the reports.

    Args:
        path: the HTML file.
        title: of the page, text.
        summary: a sentence below it, text.
        sections: head and body of each by its id, HTML; one without a body is left out.
        figures: plotly's, by the id of the element of class ``plot`` that they are drawn in; their numbers are arrays
            of float32, and a trace whose ``meta`` is the value of a box named ``law`` is shown as the box says.
        arm: what the animation needs; None without one.
    """
    sections = {name: section for name, section in sections.items() if section[1]}
    data = {"figures": {name: figure.to_dict() for name, figure in figures.items()}, "arm": arm}
    path.write_text(
        Template(_part("page.html")).substitute(
            title=escape(title),
            summary=escape(summary),
            style=_part("report.css"),
            navigation="".join(f'<li><a href="#{name}">{head}</a></li>' for name, (head, _) in sections.items()),
            sections="\n".join(
                f'<section aria-labelledby="{name}"><h2 id="{name}">{head}</h2>\n{body}</section>'
                for name, (head, body) in sections.items()
            ),
            plotly=get_plotlyjs(),
            data=json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"),
            script=_part("report.js"),
        ),
        encoding="utf-8",
    )


def _part(name: str) -> str:
    return (files(__package__) / "templates" / name).read_text(encoding="utf-8")


def _key(recording: Recording) -> tuple[str, str]:
    return recording.scenario or "run", recording.law or "unknown law"


def _case(case: str) -> str:
    return CASES.get(case, case)


def _summary(done: Mapping[tuple[str, str], Run]) -> str:
    """What the report is of, in a sentence."""
    said = []
    for metrics, run_keys in groupby(done, key=lambda key: _kind(done[key][1])):
        count = len(list(run_keys))
        said.append(f"{count} {'run' if count == 1 else 'runs'} of {metrics}")
    return "; ".join(said)


def _kind(metrics: Mapping[str, Any]) -> str:
    clock = f", {metrics['clock']} clock" if metrics["clock"] else ", without ROS"
    return f"{metrics['duration']:g} s, {metrics['samples']} samples{clock}"


def _figure(quantity: _Quantity, runs: Mapping[str, Run], laws: Mapping[str, int]) -> Any:
    """A panel a joint with all laws that have the quantity, or None where none has."""
    (first, _), *_ = runs.values()
    joints = first.joints
    figure = make_subplots(rows=len(joints), cols=1, shared_xaxes=True, vertical_spacing=0.06)
    if quantity.name == "tracking":
        for j in range(len(joints)):
            line = {"color": "#bdbdbd", "width": 5}
            figure.add_trace(_trace(first.time, first.reference[:, 0, j], "reference", line, j == 0), j + 1, 1)
    drawn = False
    for law, (recording, _) in runs.items():
        values = quantity.values(recording)
        if not np.any(values):  # a law without it
            continue
        drawn = True
        line = line_style(_colour(laws[law]), DASHES[laws[law] % len(DASHES)])
        for j in range(len(joints)):
            trace = _trace(recording.time, values[:, j], label(law), line, j == 0, law)
            figure.add_trace(trace, j + 1, 1)
    if not drawn:
        return None
    if first.event_time is not None:
        figure.add_vline(first.event_time, line={"color": "#595959", "width": 1, "dash": "dot"})
    set_style(figure, 120 + 190 * len(joints))
    figure.update_xaxes(title_text="time (s)", row=len(joints), col=1)
    for j, joint in enumerate(joints):
        figure.update_yaxes(title_text=f"{escape(joint)}: {quantity.axis}", row=j + 1, col=1)
    return figure


def set_style(figure: Any, height: int) -> None:
    """Give a plotly figure the style of the reports.

    Args:
        figure: plotly's.
        height: pixels.
    """
    figure.update_layout(
        template="plotly_white",
        height=height,
        margin={"l": 70, "r": 12, "t": 30, "b": 45},
        font={"color": "#1a1a1a", "size": 13},
        hovermode="x unified",
        legend={"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom", "itemdoubleclick": False},
    )
    figure.update_xaxes(hoverformat=".4g", showline=True, linecolor="#767676")
    figure.update_yaxes(hoverformat=".5g", exponentformat="power", zerolinecolor="#d0d0d0")


def _trace(time: Array, values: Array, name: str, line: Mapping[str, Any], legend: bool, law: str = "") -> Any:
    x, y = (part.astype(np.float32) for part in decimated(time, values, _PARTS))
    return go.Scatter(
        x=x, y=y, mode="lines", name=name, line=line, legendgroup=law or name, showlegend=legend, meta=law or None
    )


def _colour(number: int) -> str:
    return COLOURS[number % len(COLOURS)]


def line_style(colour: str, dashes: Any) -> dict[str, Any]:
    """Plotly's line of a colour and of dashes as in `figures.DASHES`."""
    dash = "solid" if dashes == "-" else ",".join(f"{_LINE_WIDTH * length:g}px" for length in dashes[1])
    return {"color": colour, "dash": dash, "width": _LINE_WIDTH}


def _packed(values: Array) -> dict[str, str]:
    """Numbers as plotly.js has them: little-endian, base64."""
    return {"dtype": "f4", "bdata": base64.b64encode(values.astype("<f4").tobytes()).decode()}


def _arm(
    cases: Mapping[str, Mapping[str, Run]], laws: Mapping[str, int], links: Sequence[float]
) -> dict[str, Any] | None:
    """What the animation needs: reference and error of each run, joints after each other at each time."""
    runs = {(case, law): recording for case, by_law in cases.items() for law, (recording, _) in by_law.items()}
    if any(len(recording.joints) != len(links) for recording in runs.values()):
        return None
    corners = np.concatenate([np.zeros((1, 2)), *(_points(r, links) for r in runs.values())])
    margin = 0.08 * sum(links)
    low, high = corners.min(axis=0) - margin, corners.max(axis=0) + margin
    width, height = high - low
    return {
        "links": list(links),
        "rate": _ARM_RATE,
        "box": [round(float(x), 3) for x in (low[0], -high[1], width, height)],
        "runs": {
            f"{case} {law}": {
                "colour": _colour(laws[law]),
                "joints": list(recording.joints),
                "event": None if recording.event_time is None else recording.event_time - float(recording.time[0]),
                "reference": _packed(_resampled(recording, recording.reference[:, 0])),
                "error": _packed(_resampled(recording, recording.error)),
            }
            for (case, law), recording in runs.items()
        },
    }


def _resampled(recording: Recording, values: Array) -> Array:
    """Values at the rate of the animation, shape (times, joints)."""
    time = recording.time - recording.time[0]
    moments = np.arange(int(time[-1] * _ARM_RATE + 1e-6) + 1) / _ARM_RATE
    return np.column_stack([np.interp(moments, time, column) for column in values.T])


def _points(recording: Recording, links: Sequence[float]) -> Array:
    """Where the ends of the links are and should be, m, shape (points, 2)."""
    angles = np.concatenate([recording.position, recording.reference[:, 0]]).cumsum(axis=1)
    x, y = ((function(angles) * np.asarray(links)).cumsum(axis=1).ravel() for function in (np.cos, np.sin))
    return np.column_stack([x, y])


def _arm_section(cases: Mapping[str, Mapping[str, Run]]) -> str:
    laws = list(dict.fromkeys(law for by_law in cases.values() for law in by_law))
    return Template(_part("arm.html")).substitute(
        cases=_options((case, _case(case)) for case in cases), laws=_options((law, label(law)) for law in laws)
    )


def _options(choices: Iterable[tuple[str, str]]) -> str:
    return "".join(f'<option value="{escape(value)}">{escape(text)}</option>' for value, text in choices)


def html_table(caption: str, head: Sequence[str], body: Iterable[str]) -> str:
    """A table that scrolls by itself where it is wider than the page; `body` has its rows as HTML."""
    columns = "".join(f'<th scope="col">{escape(text)}</th>' for text in head)
    return (
        f'<div class="scroll" role="region" tabindex="0" aria-label="{escape(caption)}"><table>'
        f"<caption>{escape(caption)}</caption><thead><tr>{columns}</tr></thead>\n<tbody>{''.join(body)}</tbody></table></div>\n"
    )


def _comparison_table(rows: Sequence[Comparison]) -> str:
    reasons = _reasons(rows)
    html = ""
    for case, of_case in groupby(rows, key=lambda row: row.claim.case):
        body = []
        for _, same in groupby(
            of_case, key=lambda row: (row.claim.quantity, row.claim.laws, row.claim.printed_in, row.claim.reason)
        ):
            lines = list(same)
            first = lines[0]
            number = list(reasons).index(first.claim.reason) + 1
            span = f' rowspan="{len(lines)}"'
            for row in lines:
                body.append("<tr>")
                if row is first:
                    where = f"<small>{escape(row.claim.printed_in)}</small>"
                    body.append(f'<th scope="rowgroup"{span}>{escape(_about(row))} {where}</th>')
                verdict = {True: ' class="holds"', False: ' class="fails"', None: ""}[row.holds]
                printed = escape(row.claim.printed())
                body.append(f"<td>{row.claim.joint + 1}</td><td>{printed}</td><td>{escape(row.project)}</td>")
                body.append(f"<td{verdict}>{escape(row.deviation)}</td>")
                if row is first:
                    body.append(f'<td{span}><a href="#why-{number}" aria-label="reason {number}">{number}</a></td>')
                body.append("</tr>\n")
        head = ("quantity", "joint", "article", "project", "deviation", "why")
        html += html_table(f"{_case(case)}: article and project", head, body)
    return html


def _about(row: Comparison) -> str:
    return f"{row.claim.quantity}, {label(row.claim.laws[0])}" if len(row.claim.laws) == 1 else row.claim.quantity


def _reasons(rows: Iterable[Comparison]) -> dict[str, list[str]]:
    """What each reason is of, in the order of the rows."""
    reasons: dict[str, list[str]] = {}
    for row in rows:
        of = f"{_case(row.claim.case)}: {row.claim.quantity.partition(',')[0]}"
        quantities = reasons.setdefault(row.claim.reason, [])
        if of not in quantities:
            quantities.append(of)
    return reasons


def _what_happened(done: Mapping[tuple[str, str], Run]) -> str:
    """What was not normal, a list a run; empty where everything was."""
    html = ""
    for (case, law), (_, metrics) in done.items():
        if said := what_happened(metrics):
            head = f"<p>{escape(f'{_case(case)}, {label(law)}')}:</p>\n" if len(done) > 1 else ""
            html += f"{head}<ul>{''.join(f'<li>{escape(text)}</li>' for text in said)}</ul>\n"
    return html


def _metrics_tables(cases: Mapping[str, Mapping[str, Run]], failed: Mapping[tuple[str, str], str]) -> str:
    html = ""
    for case, runs in cases.items():
        joints = next(iter(runs.values()))[0].joints
        body = []
        for key, name, unit, factor in _METRICS:
            if not any(key in metrics for _, metrics in runs.values()):
                continue
            text = f"{name} ({unit})" if unit else name
            for j, joint in enumerate(joints):
                head = f'<th scope="rowgroup" rowspan="{len(joints)}">{escape(text)}</th>' if j == 0 else ""
                cells = "".join(f"<td>{_cell(metrics, key, j, factor)}</td>" for _, metrics in runs.values())
                body.append(f"<tr>{head}<td>{escape(joint)}</td>{cells}</tr>\n")
        head_row = ("metric", "joint", *map(label, runs))
        html += html_table(f"{_case(case)}: metrics (–: not within the run)", head_row, body)
    for (case, law), reason in failed.items():
        html += f"<p>{escape(f'{_case(case)}, {label(law)}: {reason}')}</p>\n"
    return html


def _cell(metrics: Mapping[str, Any], key: str, joint: int, factor: float) -> str:
    if metrics["outcome"] == RAN_AWAY and key in OF_TRACKING:
        return RAN_AWAY
    value = metrics[key][joint] if key in metrics else None
    return value_text(None if value is None else factor * value)


def _plots(cases: Mapping[str, Mapping[str, Run]], figures: Mapping[str, Any], laws: Mapping[str, int]) -> str:
    html = ""
    if len(laws) > 1:
        html = boxes("Laws shown", {law: (_colour(number), label(law)) for law, number in laws.items()})
    for case in cases:
        html += f'<h3 id="plots-{escape(case)}">{escape(_case(case))}</h3>\n'
        for quantity in _QUANTITIES:
            name = f"{case}-{quantity.name}"
            if name not in figures:
                continue
            switch = ""
            if quantity.name == "error":
                switch = (
                    f'<label class="switch"><input type="checkbox" data-log="{escape(name)}">|e|, logarithmic</label>'
                )
            title = escape(f"{_case(case)}: {quantity.title}")
            html += (
                f"<figure><figcaption>{title}{switch}</figcaption>"
                f'<div class="plot" id="{escape(name)}" style="min-height:{figures[name].layout.height}px" '
                f'role="group" aria-label="{title}, interactive plot over time"></div></figure>\n'
            )
    return html


def boxes(legend: str, choices: Mapping[str, tuple[str, str]]) -> str:
    """Boxes that say whose lines are shown: colour and label of each by the ``meta`` of its traces."""
    labels = "".join(
        f'<label><input type="checkbox" name="law" value="{escape(value)}" checked>'
        f'<span class="swatch" style="background:{colour}"></span>{escape(text)}</label>'
        for value, (colour, text) in choices.items()
    )
    return f'<fieldset class="laws"><legend>{escape(legend)}</legend>{labels}</fieldset>\n'


def _verdict(rows: Iterable[Comparison]) -> str:
    """How many of the article's statements are true of the project, and which are not."""
    judged = [row for row in rows if row.holds is not None]
    false = [
        f"{_case(row.claim.case)}, joint {row.claim.joint + 1}: {row.claim.quantity} ({row.claim.printed()})"
        for row in judged
        if not row.holds
    ]
    said = f"Of {len(judged)} statements and limits of the article, {len(judged) - len(false)} are true of these runs."
    return f"{said} These are not: {'; '.join(false)}." if false else said


def _deviations(rows: Sequence[Comparison], notes: Sequence[str]) -> str:
    html = "".join(f"<p>{escape(note)}</p>\n" for note in notes)
    if rows:
        html += f"<p>{escape(_verdict(rows))}</p>\n<p>The numbers are those of the column “why” above.</p>\n<ol>"
        for number, (reason, of) in enumerate(_reasons(rows).items(), start=1):
            html += f'<li id="why-{number}"><p>{escape(reason)}</p><p class="of">{escape("; ".join(of))}</p></li>\n'
        html += "</ol>\n"
    return html
