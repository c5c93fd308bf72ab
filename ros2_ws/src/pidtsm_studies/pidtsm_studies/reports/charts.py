"""Charts of anything over anything, as plain data for charts.js."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_studies.reports.styles import looks

_DIGITS = 7
"""Significant digits of drawn numbers, about those of float32."""


@dataclass(frozen=True)
class Axis:
    """An axis of a chart.

    Attributes:
        label: with the unit.
        logarithmic: whether powers of ten are equally far apart.
        range: lowest and highest value; empty: that of the data.
        reversed: whether values decrease to the right.
    """

    label: str
    logarithmic: bool = False
    range: tuple[float, ...] = ()
    reversed: bool = False


@dataclass(frozen=True)
class Line:
    """A line of a chart.

    Attributes:
        label: text; empty: it is not in the legend.
        style: index of its look, see `looks`.
        x, y: shape (points,); what is not finite is not drawn.
        points: diameter of its points, px, if it consists of points only.
    """

    label: str
    style: int
    x: Array
    y: Array
    points: int = 0


def chart(lines: Sequence[Line], x: Axis, y: Axis) -> dict[str, Any]:
    """Data of a chart; all lines share one increasing axis, on which a line has gaps where it has no point."""
    places = np.unique(np.concatenate([line.x[np.isfinite(line.x)] for line in lines]))
    return {
        "x": [_rounded(value) for value in places],
        "x_label": x.label,
        "y_label": y.label,
        "x_log": x.logarithmic,
        "y_log": y.logarithmic,
        "y_range": list(y.range),
        "reversed": x.reversed,
        "series": [_series(line, places) for line in lines],
    }


def _series(line: Line, places: Array) -> dict[str, Any]:
    y = np.full(places.size, math.nan)
    known = np.isfinite(line.x)
    y[np.searchsorted(places, line.x[known])] = line.y[known]
    values = [_rounded(value) if math.isfinite(value) else None for value in y]
    return {"label": line.label, **looks(line.style), "points": line.points, "y": values}


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
