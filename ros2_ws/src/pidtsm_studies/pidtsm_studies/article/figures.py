"""Figures 3 to 12 of the article, drawn from a reproduction, as PNG and SVG."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Recording
from pidtsm_studies.article.claims import ARTICLE_LAWS, Reproduction, Run, printed_rmse
from pidtsm_studies.reports.figures import (
    COLOURS,
    decimated,
    envelope,
    finished,
    line,
    logarithmic,
    panels,
    save_figures,
)
from pidtsm_studies.reports.labels import CASES, label, style_indices, value_text

Runs: TypeAlias = Mapping[str, Run]
"""The runs of one case by law, in the order of `ARTICLE_LAWS`, at least one."""

_STYLES = style_indices(ARTICLE_LAWS)
_HEIGHTS = {"pidnftsm": 2.1, "dtsm": 2.2, "piddtsm": 2.3}  # drawing order: the law with spikes must not hide the others
_HATCHES = {"piddtsm": "", "pidnftsm": "///", "dtsm": ""}
_START = (0.0, 6.0)  # time range of the right panel, s: the article's transient ...
_EVENT = (-1.0, 5.0)  # ... or the time around the event, s from the event


def write_article_figures(reproduction: Reproduction, directory: Path) -> list[Path]:
    """Write Figures 3 to 12 as figure03.png, figure03.svg and so on.

    Runs that did not finish are not drawn; a case without any finished run has no figures.

    Args:
        reproduction: the runs, of any laws and cases.
        directory: output folder; created if missing.

    Returns:
        The files.
    """
    drawings: dict[str, Callable[[], Figure]] = {}
    for first, case in zip((3, 8), CASES, strict=True):
        outcomes = {law: reproduction.get((case, law), "not run") for law in ARTICLE_LAWS}
        if runs := {law: run for law, run in outcomes.items() if not isinstance(run, str)}:
            drawings |= {f"figure{first + n:02}": partial(draw, case, runs) for n, draw in enumerate(FIGURES)}
    return save_figures(drawings, directory)


def tracking(case: str, runs: Runs) -> Figure:
    """Figures 3 and 8: position and reference, and their start or the response to the event."""
    return _over_time(case, runs, "tracking", "$q$ of {} (rad)", lambda r: r.position, reference=True)


def error(case: str, runs: Runs) -> Figure:
    """Figures 4 and 9: the tracking error, and its magnitude on a logarithmic scale."""
    return _over_time(case, runs, "tracking error", "$e$ of {} (rad)", lambda r: r.error, size="$|e|$, envelope (rad)")


def rmse(case: str, runs: Runs) -> Figure:
    """Figures 5 and 10: RMSE, with the article's values, printed or computed from its percentages."""
    return _bars(case, runs, "rmse", "root mean square error", "RMSE of {} (rad)", printed_rmse(case))


def control_inputs(case: str, runs: Runs) -> Figure:
    """Figures 6 and 11: the applied torque, and its start or the response to the event."""
    return _over_time(case, runs, "control input", r"$\tau$ of {} (N m)", lambda r: r.effort)


def eci(case: str, runs: Runs) -> Figure:
    """Figures 7 and 12: energy of the control input, eq. (54)."""
    return _bars(case, runs, "eci", "energy of the control input", "ECI of {} (N m)", {})


FIGURES: tuple[Callable[[str, Runs], Figure], ...] = (tracking, error, rmse, control_inputs, eci)
"""The figures of a case in the article's order."""


def _over_time(
    case: str,
    runs: Runs,
    title: str,
    axis: str,
    values: Callable[[Recording], Array],
    reference: bool = False,
    size: str = "",
) -> Figure:
    """One row per joint, with the whole run on the left.

    Args:
        case: scenario.
        runs: runs of the laws to draw.
        title: title of the figure.
        axis: label of the vertical axes, with a placeholder for the joint.
        values: returns the values to draw, shape (samples, joints).
        reference: whether to draw the reference in the background.
        size: label of the right panels if they show the magnitude; empty: they show a part of the time.
    """
    (first, _), *_ = runs.values()
    figure, table = panels(len(first.joints), width_ratios=(3, 2))
    for j, (whole, beside) in enumerate(table):
        if reference:
            for ax, shown in ((whole, np.full(first.time.size, True)), (beside, _window(first))):
                points = decimated(first.time[shown], first.reference[shown, 0, j])
                ax.plot(*points, color="0.78", linewidth=4.0, label="reference")
        for law, (recording, _) in runs.items():
            time, drawn = recording.time, values(recording)[:, j]
            part = envelope(time, np.abs(drawn)) if size else (time[_window(recording)], drawn[_window(recording)])
            for ax, points in ((whole, (time, drawn)), (beside, part)):
                line(ax, *points, _STYLES[law], label(law), _HEIGHTS[law])
        whole.set_ylabel(axis.format(first.joints[j]))
        if size:
            logarithmic(beside)
            beside.set_ylabel(size)
    return finished(figure, table, first, f"{CASES[case]}: {title}")


def _window(recording: Recording) -> NDArray[np.bool_]:
    """Samples shown in the right panel."""
    origin, (begin, end) = (
        (recording.time[0], _START) if recording.event_time is None else (recording.event_time, _EVENT)
    )
    return (recording.time >= origin + begin) & (recording.time <= origin + end)


def _bars(case: str, runs: Runs, key: str, title: str, axis: str, printed: Mapping[str, list[float]]) -> Figure:
    """One panel per joint with one bar per law, and a mark if the article has a value."""
    (first, _), *_ = runs.values()
    figure, table = panels(1, width_ratios=(1,) * len(first.joints))
    marked = {place: printed[law] for place, law in enumerate(runs) if law in printed}
    for j, ax in enumerate(table[0]):
        values = {law: metrics[key][j] for law, (_, metrics) in runs.items()}
        ax.bar(
            [f"{label(law)}\n{value_text(value)}" for law, value in values.items()],
            list(values.values()),
            width=0.6,
            color=[COLOURS[_STYLES[law]] for law in runs],
            hatch=[_HATCHES[law] for law in runs],
            edgecolor="white",
        )
        if marked:
            heights = [value[j] for value in marked.values()]
            ax.plot(list(marked), heights, "D", color="white", markeredgecolor="#D55E00", markersize=6, label="article")
        ax.set_axisbelow(True)
        ax.grid(axis="x", visible=False)
        ax.margins(x=0.1, y=0.1)
        ax.set_ylabel(axis.format(first.joints[j]))
    table[0, 0].set_title(f"{CASES[case]}: {title}", loc="left", y=1.0)
    if marked:
        table[0, -1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    return figure
