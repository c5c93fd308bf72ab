"""Figures of a recorded run, as PNG and SVG."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Recording
from pidtsm_core.signals import Signal
from pidtsm_core.units import alike

Table: TypeAlias = NDArray[np.object_]
"""Axes, shape (rows, columns)."""

COLOURS = ("#0072B2", "#E69F00", "#000000", "#56B4E9", "#009E73", "#CC79A7", "#882255")
"""Okabe and Ito's colours (wine instead of yellow, which is invisible on white), alternately dark and light so that
neighbours differ in greyscale."""
DASHES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (4, 1, 1, 1)), (0, (8, 2)), (0, (2, 1)), (0, (6, 1)))
"""Matplotlib line styles, as many as `COLOURS`, to distinguish lines without colour."""
STYLE: Any = {
    "font.size": 9,
    "axes.labelsize": 9,
    "axes.titlesize": 9,
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.xmargin": 0.0,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "figure.dpi": 200,
    "svg.fonttype": "none",  # text as text: small and searchable
    "svg.hashsalt": "pidtsm",  # the same run gives the same file
}
"""Matplotlib settings for every figure."""
MARK: dict[str, Any] = {
    "color": "#D55E00",
    "linewidth": 4.0,
    "solid_capstyle": "butt",
    "clip_on": False,
}
"""Line above a panel that marks time intervals."""

# What follows the unit of the position in those of s, sigma, tau_sw and Y, which depend on the law's surface and
# manifold: tau_sw is sigma with a manifold (eq. (32)), its rate without one.
_PER_TIME = {
    "piddtsm": ("/s", "/s$^2$", "/s$^2$", "/s$^3$"),
    "dtsm": ("/s", "/s", "/s$^2$", "/s$^3$"),
    "pidnftsm": ("", "/s", "/s", "/s$^2$"),
}
_WITH_UNITS = (Signal.SLIDING_VARIABLE, Signal.MANIFOLD_VARIABLE, Signal.SWITCHING_TERM, Signal.ADAPTIVE_GAIN)
PARTS = 500
"""Number of parts of the time axis; a line keeps the extremes of each part."""

_WIDTH = 7.0  # inch, as everything here
_PANEL = 1.5  # height of a panel
_LEFT, _RIGHT, _ABOVE, _BELOW = 0.95, 0.15, 0.35, 0.5  # space around the panels, for the labels
_BESIDE, _BETWEEN = 0.95, 0.2  # space between columns, and between rows
_LABEL = 0.62  # from a panel to the label of its vertical axis
_TOGETHER = 3
"""Largest number of joints in a panel; more lines could not be distinguished."""
_START = 1.0  # duration of the start of a run, s


def write_figures(recording: Recording, directory: Path) -> list[Path]:
    """Write all figures as PNG and SVG.

    Args:
        recording: the run.
        directory: output folder; created if missing.

    Returns:
        The files.
    """
    return save_figures({name: partial(draw, recording) for name, draw in FIGURES.items()}, directory)


def save_figures(drawings: Mapping[str, Callable[[], Figure]], directory: Path) -> list[Path]:
    """Draw each figure in the style of this module and write it as PNG and SVG.

    Args:
        drawings: function that draws each figure, by file name.
        directory: output folder; created if missing.

    Returns:
        The files.
    """
    directory.mkdir(parents=True, exist_ok=True)
    files = []
    with matplotlib.rc_context(STYLE):
        for name, draw in drawings.items():
            figure = draw()
            for suffix, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
                files.append(directory / f"{name}.{suffix}")
                figure.savefig(files[-1], metadata=metadata)
    return files


def tracking(recording: Recording) -> Figure:
    """True position and reference, one panel per joint."""
    figure, table = panels(len(recording.joints))
    desired = recording.desired
    for j, (ax, joint) in enumerate(zip(table[:, 0], recording.joints, strict=True)):
        line(ax, recording.time, recording.position[:, j], 0, "$q$")
        line(ax, recording.time, desired[:, j], 1, "$q_d$")
        ax.set_ylabel(f"{joint}\n$q$ ({recording.units[j].position})")
    return finished(figure, table, recording)


def error(recording: Recording) -> Figure:
    """True tracking error, eq. (7), and its magnitude on a logarithmic scale."""
    groups, error = alike(recording.units, _TOGETHER), recording.error
    figure, table = panels(2 * len(groups), groups=len(groups))
    for group, (signed, size) in zip(groups, table.reshape(-1, 2), strict=True):
        for style, j in enumerate(group):
            line(signed, recording.time, error[:, j], style, recording.joints[j])
            line(size, *envelope(recording.time, np.abs(error[:, j])), style, recording.joints[j])
        unit = recording.units[group[0]].position
        signed.set_ylabel(f"$e = q - q_d$ ({unit})")
        size.set_ylabel(f"$|e|$, envelope ({unit})")
        logarithmic(size)
    return finished(figure, table, recording, groups=len(groups))


def torque(recording: Recording) -> Figure:
    """Applied effort, one row per joint: the whole run and its start; marks show when the effort is at its limit."""
    figure, table = panels(len(recording.joints), width_ratios=(3, 1))
    for j, (row, joint) in enumerate(zip(table, recording.joints, strict=True)):
        for ax, shown in zip(row, (slice(None), _start(recording)), strict=True):
            time = recording.time[shown]
            line(ax, time, recording.effort[shown, j], 0, "applied effort")
            _mark(ax, time, recording.signals[shown, Signal.SATURATED, j] != 0.0, "at its limit")
        row[0].set_ylabel(f"{joint}\n$\\tau$ ({recording.units[j].effort})")
        row[1].sharey(row[0])
    return finished(figure, table, recording)


def sliding_variables(recording: Recording) -> Figure:
    """Sliding variable s, eq. (11), and manifold variable sigma, eq. (10): magnitude, and the start with sign."""
    groups = alike(recording.units, _TOGETHER)
    figure, table = panels(2 * len(groups), width_ratios=(2, 1), groups=len(groups))
    start = _start(recording)
    variables = ((Signal.SLIDING_VARIABLE, "s"), (Signal.MANIFOLD_VARIABLE, r"\sigma"))
    for (size, signed), (group, (signal, name)) in zip(table, product(groups, variables), strict=True):
        for style, j in enumerate(group):
            values = recording.signals[:, signal, j]
            line(size, *envelope(recording.time, np.abs(values)), style, recording.joints[j])
            line(signed, recording.time[start], values[start], style, recording.joints[j])
        unit = _unit(recording, group, signal)
        logarithmic(size)
        size.set_ylabel(f"$|{name}|$, envelope ({unit})")
        signed.set_ylabel(f"${name}$ ({unit})")
    return finished(figure, table, recording, groups=len(groups))


def adaptive_gain(recording: Recording) -> Figure:
    """Adaptive gain Y, eq. (27), and switching term tau_sw, eq. (25)."""
    groups = alike(recording.units, _TOGETHER)
    figure, table = panels(2 * len(groups), groups=len(groups))
    terms = ((Signal.ADAPTIVE_GAIN, "Y"), (Signal.SWITCHING_TERM, r"\tau_{sw}"))
    for ax, (group, (signal, name)) in zip(table[:, 0], product(groups, terms), strict=True):
        for style, j in enumerate(group):
            line(ax, recording.time, recording.signals[:, signal, j], style, recording.joints[j])
        ax.set_ylabel(f"${name}$ ({_unit(recording, group, signal)})")
    return finished(figure, table, recording, groups=len(groups))


FIGURES: dict[str, Callable[[Recording], Figure]] = {
    "tracking": tracking,
    "error": error,
    "torque": torque,
    "sliding_variables": sliding_variables,
    "adaptive_gain": adaptive_gain,
}
"""Every figure by file name."""


def _unit(recording: Recording, group: Sequence[int], signal: Signal) -> str:
    """Unit of a signal of the law for a group of joints with the same units."""
    if recording.law not in _PER_TIME:
        return "SI unit"
    return recording.units[group[0]].position + _PER_TIME[recording.law][_WITH_UNITS.index(signal)]


def _start(recording: Recording) -> slice:
    """Samples of the start of a run."""
    return slice(int(np.searchsorted(recording.time, recording.time[0] + _START, side="right")))


def panels(rows: int, width_ratios: Sequence[float] = (1,), groups: int = 1) -> tuple[Figure, Table]:
    """A figure of panels with common time axes.

    Places are fixed: to find them, Matplotlib would lay out every text of the figure several times, which took longer
    than to draw it.

    Args:
        rows: number of rows.
        width_ratios: relative widths of the columns.
        groups: number of groups of rows, below each other, each with space for a legend above it.

    Returns:
        The figure, and its axes of shape (rows, columns).
    """
    columns, gaps = len(width_ratios), groups - 1
    height = _ABOVE + rows * _PANEL + (rows - 1) * _BETWEEN + gaps * _ABOVE + _BELOW
    figure = Figure(figsize=(_WIDTH, height))
    widths = (_WIDTH - _LEFT - _RIGHT - (columns - 1) * _BESIDE) * np.array(width_ratios) / np.sum(width_ratios)
    table = figure.subplots(rows, columns, sharex="col", squeeze=False)
    for row, column in product(range(rows), range(columns)):
        left = _LEFT + widths[:column].sum() + column * _BESIDE
        top = _ABOVE + row * (_PANEL + _BETWEEN) + row // (rows // groups) * _ABOVE
        place = (left / _WIDTH, 1.0 - (top + _PANEL) / height, widths[column] / _WIDTH, _PANEL / height)
        ax = table[row, column]
        ax.set_position(place)
        ax.yaxis.set_label_coords(-_LABEL / widths[column], 0.5)
        ax.xaxis.set_label_coords(0.5, -0.3 / _PANEL)
    return figure, table


def finished(figure: Figure, table: Table, recording: Recording, title: str | None = None, groups: int = 1) -> Figure:
    """Add the common elements of all figures: event, title, legends, label and end of the time axis.

    Args:
        figure: created by `panels`.
        table: its axes, shape (rows, columns).
        recording: the run.
        title: title; None: scenario, law and clock of the run.
        groups: number of groups of joints, as given to `panels`; each has a legend.

    Returns:
        The figure.
    """
    if recording.event_time is not None:
        for ax in table[:, 0]:
            ax.axvline(recording.event_time, color="0.35", linewidth=0.8, linestyle=":", label="event")
    run = ", ".join(filter(None, (recording.scenario, recording.law, recording.clock)))
    table[0, 0].set_title(title or run, loc="left", y=1.0)
    for row in range(0, len(table), len(table) // groups):
        lines, labels = table[row, 0].get_legend_handles_labels()
        above = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "ncols": len(labels), "borderaxespad": 0.1}
        table[row, -1].legend(lines, labels, **above)  # next to the title, above all columns
    for ax in table[-1]:
        ax.set_xlabel("time (s)")
    if recording.time.size > 1:  # the last sample lasts for the median of the periods
        table[-1, 0].set_xlim(recording.time[0], recording.time[-1] + np.median(np.diff(recording.time)))
    return figure


def line(ax: Axes, time: Array, values: Array, style: int, label: str, zorder: float = 2.0) -> None:
    """Draw a decimated line.

    Args:
        ax: axes.
        time: s, shape (samples,).
        values: in the unit of the axis, shape (samples,).
        style: index into `COLOURS` and `DASHES`, modulo their length.
        label: label in the legend.
        zorder: lines with larger values are drawn above the others.
    """
    ax.plot(
        *decimated(time, values),
        color=COLOURS[style % len(COLOURS)],
        linestyle=DASHES[style % len(DASHES)],
        label=label,
        zorder=zorder,
    )


def _mark(ax: Axes, time: Array, where: NDArray[np.bool_], label: str) -> None:
    """Mark times above the panel; even the mark of a single sample is wide enough to be visible."""
    begins = _parts(time)
    ends = np.append(time[begins[1:]], time[-1])
    height = np.where(np.logical_or.reduceat(where, begins), 1.02, np.nan)
    spans = np.column_stack((time[begins], ends)).ravel()
    ax.plot(spans, np.repeat(height, 2), transform=ax.get_xaxis_transform(), label=label, **MARK)


def logarithmic(ax: Axes) -> None:
    """Make the vertical axis logarithmic, if there are positive values."""
    if any(np.any(np.asarray(drawn.get_ydata()) > 0.0) for drawn in ax.lines):
        ax.set_yscale("log", nonpositive="mask")


def _parts(time: Array, parts: int = PARTS) -> NDArray[np.intp]:
    """Index of the first sample of each nonempty part of the time axis, shape (at most parts,)."""
    part = np.minimum((time - time[0]) / max(np.ptp(time), 1e-9) * parts, parts - 1).astype(np.intp)
    return np.flatnonzero(np.diff(part, prepend=-1))


def decimated(time: Array, values: Array, parts: int = PARTS) -> tuple[Array, Array]:
    """The smallest and the largest value of each part of the time axis, so that no spike is lost.

    Args:
        time: s, increasing, shape (samples,).
        values: shape (samples,).
        parts: number of parts of the time axis.

    Returns:
        Time and values of the kept samples, including the first and the last, shape (at most 2 parts + 2,) each.
    """
    if time.size <= 2 * parts:
        return time, values
    begins = _parts(time, parts)
    ends = np.append(begins[1:], time.size)
    kept = [
        index
        for begin, end in zip(begins, ends, strict=True)
        for index in (begin + values[begin:end].argmin(), begin + values[begin:end].argmax())
    ]
    keep = np.unique([0, *kept, time.size - 1])
    return time[keep], values[keep]


def envelope(time: Array, values: Array) -> tuple[Array, Array]:
    """The largest value of each part of the time axis.

    Args:
        time: s, increasing, shape (samples,).
        values: shape (samples,).

    Returns:
        Start of each part, s, and its largest value, shape (at most `PARTS`,) each.
    """
    begins = _parts(time)
    return time[begins], np.maximum.reduceat(values, begins)
