"""The page of `robustness`: rows against limits, what is tolerated, and every curve; one HTML file."""

from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from pidtsm_core.parameters import Array
from pidtsm_studies.reports.report import boxes, html_table, line_style, set_style, write_page
from pidtsm_studies.robustness.figures import LOGARITHMIC, PANELS, STYLES, shown
from pidtsm_studies.robustness.study import (
    BAND,
    CONFIDENCE,
    CONTENDERS,
    IMPERFECTIONS,
    LABELS,
    LATE,
    QUANTITIES,
    ROW_CONTENDERS,
    ROWS,
    TRACKING,
    Imperfection,
    Robustness,
    measured_text,
    tolerance,
)


def write_robustness_report(path: Path, robustness: Robustness) -> None:
    """Write the page; the same results give the same file."""
    effort = robustness.effort
    figures = {each.name: _figure(robustness, each) for each in IMPERFECTIONS}
    sections = {
        "rows": ("Imperfect hardware, against limits", _rows(robustness)),
        "tolerance": ("What each controller tolerates", _tolerance(robustness)),
        "curves": ("Curves", _curves(figures)),
        "method": ("How it was measured", _method(robustness)),
    }
    summary = f"Case 1, {robustness.runs} rollouts of {effort.duration:g} s, up to {effort.seeds} seeds a value"
    write_page(path, "Robustness", summary, sections, figures)


def _rows(robustness: Robustness) -> str:
    body = []
    for row, judged in zip(ROWS, robustness.rows, strict=True):
        for contender in ROW_CONTENDERS:
            each = judged[contender.name]
            met = each.met(row)
            cells = ""
            for name, limit in row.limits.items():
                verdict = "holds" if met[name] else "fails"
                text = measured_text(each.values[name])
                if np.isfinite(limit):
                    cells += f'<td class="{verdict}">{text} <small>at most {limit:g}</small></td>'
                else:
                    cells += f"<td>{text}</td>"
            head = f'<th scope="rowgroup" rowspan="{len(ROW_CONTENDERS)}">{escape(row.label)}</th>'
            body.append(
                f"<tr>{head if contender is ROW_CONTENDERS[0] else ''}<td>{escape(contender.heading)}</td>{cells}"
                f"<td>{100.0 * each.success:.0f} %</td></tr>\n"
            )
    caption = f"The practical set is within its limits in {robustness.met()} of {len(ROWS)} rows"
    return html_table(caption, ("hardware", "controller", *QUANTITIES.values(), "success"), body)


def _tolerance(robustness: Robustness) -> str:
    body = []
    for imperfection in IMPERFECTIONS:
        cells = "".join(f"<td>{escape(tolerance(robustness, imperfection, c.name))}</td>" for c in CONTENDERS)
        first, *_, last = robustness.values[imperfection.name]
        head = f'<th scope="row">{escape(imperfection.label)}</th><td>{first:g} to {last:g}</td>'
        body.append(f"<tr>{head}{cells}</tr>\n")
    caption = "The last value, from the mildest on, up to which every run succeeded"
    return html_table(caption, ("imperfection", "tried", *(c.heading for c in CONTENDERS)), body)


def _curves(figures: dict[str, Any]) -> str:
    html = boxes("Controllers shown", {name: (colour, LABELS[name]) for name, (colour, _) in STYLES.items()})
    for imperfection in IMPERFECTIONS:
        title = escape(imperfection.label[0].upper() + imperfection.label[1:])
        html += (
            f'<figure><figcaption>{title}</figcaption><div class="plot" id="{imperfection.name}" '
            f'style="min-height:{figures[imperfection.name].layout.height}px" role="group" '
            f'aria-label="{title}, interactive plot"></div></figure>\n'
        )
    return html


def _figure(robustness: Robustness, imperfection: Imperfection) -> Any:
    figure = make_subplots(rows=len(PANELS), cols=1, shared_xaxes=True, vertical_spacing=0.035)
    values = np.array(robustness.values[imperfection.name], dtype=np.float64)
    for contender, curve in robustness.curves[imperfection.name].items():
        colour, dashes = STYLES[contender]
        for number, panel in enumerate(PANELS, start=1):
            low, middle, high = shown(curve, panel)
            common = {"meta": contender, "name": LABELS[contender], "legendgroup": contender}
            if imperfection.random:
                x, y = _edge(values, low, high)
                shape = {"mode": "none", "fill": "toself", "fillcolor": colour, "opacity": 0.15, "hoverinfo": "skip"}
                figure.add_trace(go.Scatter(x=x, y=y, **shape, **common, showlegend=False), number, 1)
            line = go.Scatter(
                x=values.astype(np.float32),
                y=middle.astype(np.float32),
                **common,
                mode="lines+markers",
                marker={"size": 4, "color": colour},
                line=line_style(colour, dashes),
                showlegend=number == 1,
            )
            figure.add_trace(line, number, 1)
    set_style(figure, 200 + 190 * len(PANELS))
    ends = np.log10(values[[0, -1]]) if imperfection.logarithmic else values[[0, -1]]
    scale = "log" if imperfection.logarithmic else "linear"
    figure.update_xaxes(type=scale, range=[float(end) for end in ends], exponentformat="power")  # mildest at the left
    if imperfection.logarithmic:
        figure.update_xaxes(dtick=1)
    figure.update_xaxes(title_text=escape(imperfection.label), row=len(PANELS), col=1)
    for number, (panel, name) in enumerate(PANELS.items(), start=1):
        scale = "log" if panel in LOGARITHMIC else "linear"
        figure.update_yaxes(title_text=escape(name).replace("\n", "<br>"), type=scale, row=number, col=1)
    return figure


def _edge(values: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Points around a band, there and back; around each part of its own, with nan between, where it has gaps."""
    exists = np.isfinite(low) & np.isfinite(high)
    parts = np.split(np.arange(values.size), np.flatnonzero(np.diff(exists)) + 1)
    x, y = [np.empty(0)], [np.empty(0)]
    for part in parts:
        if exists[part[0]]:
            x += [values[part], values[part][::-1], np.array([np.nan])]
            y += [low[part], high[part][::-1], np.array([np.nan])]
    return np.concatenate(x).astype(np.float32), np.concatenate(y).astype(np.float32)


def _method(robustness: Robustness) -> str:
    effort = robustness.effort
    low, middle, high = BAND
    said = (
        f"A curve varies one imperfection of Case 1 over {effort.values} values and leaves all else ideal. Where "
        f"something is random (noise, losses), each value is run with {effort.seeds} seeds; elsewhere every seed gives "
        "the same run, and it is made once.",
        f"A run succeeds if every joint's error stays below {TRACKING:g} rad and its torque off its limits from "
        f"{LATE:g} s on. The band of a success rate is Wilson's interval for {100 * CONFIDENCE:g} % confidence; that "
        f"of another curve goes from the {low:g}th to the {high:g}th percentile over the seeds, and the curve is the "
        f"{middle:g}th.",
        "RMSE is the root of both joints' sum of squares, ECI and torque variation are both joints' sums. A run that "
        "leaves the finite numbers has failed, and has no such values: "
        f"{robustness.diverged} of {robustness.runs} runs.",
        "In the table of rows a value is the mean over the seeds (the largest, for the error) of the worse joint and "
        "of the worse of the variants. RMSE and ECI are relative to the same controller with ideal hardware.",
        "“practical” is the proposed law with the parameters for real hardware (--params practical), one set for all "
        "that is shown; “article” is it with the article's parameters and filtered differences, “levant” with Levant's "
        "robust differentiator in their place. The other laws have the article's parameters where it has some, their "
        "defaults elsewhere, and filtered differences.",
    )
    return "".join(f"<p>{escape(text)}</p>\n" for text in said)
