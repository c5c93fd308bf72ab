"""Figures of the study: one per imperfection, as PNG and SVG."""

from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pidtsm_core.parameters import Array
from pidtsm_studies.reports.figures import COLOURS, DASHES, panels, save_figures
from pidtsm_studies.robustness.contenders import ESTIMATORS, LABELS, LAWS
from pidtsm_studies.robustness.imperfections import IMPERFECTIONS, Imperfection
from pidtsm_studies.robustness.results import Curve, Robustness, combined

PANELS = {
    "success": "success rate",
    "rmse": "RMSE (rad)",
    "eci": "ECI (N m)",
    "torque_variation": "torque variation\n(N m per sample)",
}
"""Quantity of each row of panels. Joints are combined by the root of the sum of squares for RMSE, by the sum for ECI
and variation."""
LOGARITHMIC = ("rmse", "torque_variation")

# One more than in `figures`, where this colour marks saturation, which is not shown here.
_COLOURS = (*COLOURS, "#D55E00")
_DASHES = (*DASHES, (0, (5, 1, 1, 1, 1, 1)))
STYLES = dict(zip(LABELS, zip(_COLOURS, _DASHES, strict=True), strict=True))
"""Colour and dashes of each contender."""


def write_robustness_figures(robustness: Robustness, directory: Path) -> list[Path]:
    """Write one figure per imperfection.

    Args:
        robustness: the results.
        directory: output folder; created if missing.

    Returns:
        The files.
    """
    drawings = {each.name: partial(_figure, robustness, each) for each in IMPERFECTIONS}
    return save_figures(drawings, directory)


def band(curve: Curve, panel: str) -> tuple[Array, Array, Array]:
    """Lower edge of the band, curve and upper edge, each of shape (values,); nan where there is no value.

    Args:
        curve: curve of a contender.
        panel: one of `PANELS`.
    """
    if panel == "success":
        low, high = curve.interval
        return low, curve.success, high
    percentiles = combined(panel, curve.metrics[panel])
    low, middle, high = np.where(np.isfinite(percentiles), percentiles, np.nan)
    return low, middle, high


def _figure(robustness: Robustness, imperfection: Imperfection) -> Figure:
    """On the left the proposed law with each estimator, on the right all laws."""
    figure, table = panels(len(PANELS), width_ratios=(1, 1))
    values = np.array(robustness.values[imperfection.name], dtype=np.float64)
    curves = robustness.curves[imperfection.name]
    for row, (panel, name) in zip(table, PANELS.items(), strict=True):
        row[1].sharey(row[0])
        for ax, contenders in zip(row, (ESTIMATORS, LAWS), strict=True):
            for contender in (name for name in contenders if name in curves):
                _draw(ax, values, band(curves[contender], panel), contender)
            if panel in LOGARITHMIC:
                ax.set_yscale("log", nonpositive="mask")
        row[0].set_ylabel(name)
    table[0, 0].set_ylim(-0.05, 1.05)
    for ax, title in zip(table[0], ("the proposed law, by estimator", "all laws"), strict=True):
        ax.set_title(title, loc="left")
    for ax in table[-1]:
        if imperfection.logarithmic:
            ax.set_xscale("log")
        ax.set_xlim(values[0], values[-1])  # the mildest on the left
        ax.set_xlabel(imperfection.label)
    figure.legend(*table[0, 0].get_legend_handles_labels(), loc="outside lower left")
    figure.legend(*table[0, 1].get_legend_handles_labels(), loc="outside lower right", ncols=2)
    for ax in table.flat:
        ax.minorticks_off()
    figure.align_ylabels()
    return figure


def _draw(ax: Axes, values: Array, curve: tuple[Array, Array, Array], contender: str) -> None:
    colour, dashes = STYLES[contender]
    low, middle, high = curve
    ax.fill_between(values, low, high, color=colour, alpha=0.15, linewidth=0.0)
    ax.plot(values, middle, color=colour, linestyle=dashes, label=LABELS[contender], clip_on=False)
