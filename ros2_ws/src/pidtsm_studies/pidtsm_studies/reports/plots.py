"""Interactive plots of the reports: plotly figures with one panel per joint."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Recording
from pidtsm_core.signals import Signal
from pidtsm_studies.article.claims import Run
from pidtsm_studies.reports.figures import COLOURS, DASHES, decimated
from pidtsm_studies.reports.labels import DIGITS, Entry

_PARTS = 1000  # parts of the time axis; a line keeps the extremes of each part
_LINE_WIDTH, _GAP, _TOP, _BOTTOM = 1.8, 25.5, 30, 45  # pixels


@dataclass(frozen=True)
class Quantity:
    """A quantity plotted over time.

    Attributes:
        name: name used in ids.
        title: title of the plot.
        axis: label of the vertical axes, in plotly's markup; {position} and {effort} are units of the joint.
        values: returns the values of a run, shape (samples, joints).
        magnitude: the same label for the magnitude on a logarithmic axis; empty: not offered.
    """

    name: str
    title: str
    axis: str
    values: Callable[[Recording], Array]
    magnitude: str = ""


def _signal(signal: Signal) -> Callable[[Recording], Array]:
    return lambda recording: recording.signals[:, signal]


QUANTITIES = (
    Quantity("tracking", "Tracking", "q ({position})", lambda recording: recording.position),
    Quantity(
        "error",
        "Tracking error",
        "e = q − q<sub>d</sub> ({position})",
        lambda recording: recording.error,
        magnitude="|e| ({position})",
    ),
    Quantity("torque", "Applied effort", "τ ({effort})", lambda recording: recording.effort),
    Quantity("sliding", "Sliding variable s, in the unit of the law's surface", "s", _signal(Signal.SLIDING_VARIABLE)),
    Quantity("manifold", "Manifold variable σ, in the unit of the law", "σ", _signal(Signal.MANIFOLD_VARIABLE)),
    Quantity("gain", "Adaptive gain Υ, in the unit of σ per second", "Υ", _signal(Signal.ADAPTIVE_GAIN)),
)
"""Every quantity in the order of the plots."""


def plot(quantity: Quantity, runs: Mapping[str, Run], entries: Mapping[str, Entry]) -> Any:
    """A quantity of every run that has it, over time.

    Args:
        quantity: one of `QUANTITIES`.
        runs: runs with the same joints by law or name, at least one.
        entries: legend, by law or name.

    Returns:
        The plotly figure, or None if the quantity is zero in every run.
    """
    values = {key: quantity.values(recording) for key, (recording, _) in runs.items()}
    shown = [key for key in runs if np.any(values[key])]  # A law without the quantity has zeros.
    if not shown:
        return None
    first = next(iter(runs.values()))[0]
    height = 120 + 190 * len(first.joints)
    gap = _GAP / (height - _TOP - _BOTTOM)
    figure = make_subplots(rows=len(first.joints), cols=1, shared_xaxes=True, vertical_spacing=gap)
    if quantity.name == "tracking":
        _add_references(figure, runs, entries)
    for key in shown:
        entry = entries[key]
        line = line_style(colour(entry.style), dashes(entry.style))
        for j in range(len(first.joints)):
            figure.add_trace(_trace(runs[key][0].time, values[key][:, j], entry.label, line, j == 0, key), j + 1, 1)
    if first.event_time is not None:
        figure.add_vline(first.event_time, line={"color": "#595959", "width": 1, "dash": "dot"})
    set_style(figure, height)
    figure.update_xaxes(title_text="time (s)", row=len(first.joints), col=1)
    for j, (joint, units) in enumerate(zip(first.joints, first.units, strict=True)):
        axis = quantity.axis.format(**units._asdict())
        figure.update_yaxes(title_text=f"{escape(joint)}<br>{axis}", row=j + 1, col=1)
    if quantity.magnitude:  # For report.js.
        labels = (quantity.magnitude.format(**units._asdict()) for units in first.units)
        magnitudes = [f"{escape(joint)}<br>{axis}" for joint, axis in zip(first.joints, labels, strict=True)]
        figure.update_layout(meta={"magnitudes": magnitudes})
    return figure


def _add_references(figure: Any, runs: Mapping[str, Run], entries: Mapping[str, Entry]) -> None:
    """Draw the reference of all runs behind them, or that of each run if they differ."""
    line = {"color": "#bdbdbd", "width": 5}
    recordings = {key: recording for key, (recording, _) in runs.items()}
    longest = max(recordings.values(), key=lambda recording: recording.time.size)
    if all(_begins_with(longest, recording) for recording in recordings.values()):
        references = {"": ("reference", longest)}
    else:
        references = {key: (f"reference of {entries[key].label}", each) for key, each in recordings.items()}
    for key, (name, recording) in references.items():
        for j, desired in enumerate(recording.desired.T):
            figure.add_trace(_trace(recording.time, desired, name, line, j == 0, key), j + 1, 1)


def _begins_with(recording: Recording, other: Recording) -> bool:
    """Whether the reference of a recording begins with that of another one, at the same times."""
    times, reference = recording.time[: other.time.size], recording.reference[: other.time.size, 0]
    return np.array_equal(times, other.time) and np.allclose(reference, other.reference[:, 0], rtol=0.0, atol=1e-9)


def set_style(figure: Any, height: int) -> None:
    """Give a figure the style of the reports.

    Args:
        figure: plotly figure.
        height: pixels.
    """
    figure.update_layout(
        template="plotly_white",
        height=height,
        margin={"l": 70, "r": 12, "t": _TOP, "b": _BOTTOM},
        font={"color": "#1a1a1a", "size": 13},
        hovermode="x unified",
        legend={"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom", "itemdoubleclick": False},
    )
    figure.update_xaxes(hoverformat=f".{DIGITS}g", showline=True, linecolor="#767676")
    figure.update_yaxes(hoverformat=f".{DIGITS}g", exponentformat="power", zerolinecolor="#d0d0d0")


def line_style(colour: str, dashes: Any) -> dict[str, Any]:
    """A line style for plotly.

    Args:
        colour: CSS colour.
        dashes: matplotlib line style, as in `figures.DASHES`.
    """
    dash = "solid" if dashes == "-" else ",".join(f"{_LINE_WIDTH * length:g}px" for length in dashes[1])
    return {"color": colour, "dash": dash, "width": _LINE_WIDTH}


def colour(style: int) -> str:
    """Colour of the style with this index."""
    return COLOURS[style % len(COLOURS)]


def dashes(style: int) -> Any:
    """Matplotlib line style of the style with this index; a colour that comes again has other dashes."""
    return DASHES[(style + style // len(COLOURS)) % len(DASHES)]


def _trace(time: Array, values: Array, name: str, line: Mapping[str, Any], legend: bool, key: str = "") -> Any:
    x, y = (part.astype(np.float32) for part in decimated(time, values, _PARTS))
    return go.Scatter(
        x=x, y=y, mode="lines", name=name, line=line, legendgroup=name, showlegend=legend, meta=key or None
    )
