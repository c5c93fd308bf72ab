"""Scrolling curves: what the controller computes, per joint, over the last seconds."""

from collections.abc import Sequence

import numpy as np
from viser import GuiApi, GuiUplotHandle, uplot

from pidtsm_core.arrays import Array
from pidtsm_core.signals import Signal
from pidtsm_experiments.live.history import SPAN, Curves

COLORS = ("#1c7ed6", "#f76707", "#2f9e44", "#ae3ec9", "#e03131", "#0c8599", "#846358", "#f06595")
SHOWN = {
    Signal.POSITION_ERROR: "error e [{position}]",
    Signal.EFFORT: "torque [{effort}]",
    Signal.SLIDING_VARIABLE: "1000 times the sliding variable s",
    Signal.ADAPTIVE_GAIN: "switching gain Y",
}
"""The signals with a plot, and its title with the units of the joints."""
_MILLI = 1e3
_SCALED = (Signal.POSITION_ERROR, Signal.SLIDING_VARIABLE)
"""Signals drawn in thousandths: the labels of the axes have three decimals."""
_HEIGHT = 150  # pixels
_NOTHING = np.array([-SPAN, 0.0])
_AXES: tuple[uplot.Axis, ...] = ({"size": 24}, {"size": 52})


def color(joint: int) -> str:
    """Colour of a joint's curves."""
    return COLORS[joint % len(COLORS)]


class Plots:
    """One plot for each of `SHOWN`, with one curve per joint, over the time before now."""

    def __init__(self, gui: GuiApi, joints: Sequence[str], units: dict[str, str]) -> None:
        """Add the plots to the current container; `units`: of positions and efforts."""
        series = [uplot.Series(label="s"), *(_curve(joint, color(i)) for i, joint in enumerate(joints))]
        self._plots = [_plot(gui, len(joints), series, title.format(**units), (-SPAN, 0.0)) for title in SHOWN.values()]

    def show(self, curves: Curves, silence: float = 0.0) -> None:
        """Draw the curves; their signals are those of `SHOWN`. They go on to the left when nothing follows.

        `silence`: time since the last point, s.
        """
        if not curves.time.size:
            return
        time = curves.time - curves.time[-1] - silence
        for i, (signal, plot) in enumerate(zip(SHOWN, self._plots, strict=True)):
            scale = _MILLI if signal in _SCALED else 1.0
            plot.data = (time, *np.ascontiguousarray(scale * curves.values[:, i].T))


class Comparison:
    """The error of one joint since a mark, beside the kept curve A."""

    def __init__(self, gui: GuiApi) -> None:
        """Add the plot to the current container."""
        series = [uplot.Series(label="s"), _curve("A", "#868e96", 2.0), _curve("now", "#1c7ed6")]
        self._plot = _plot(gui, 2, series, "1000 times the error since the mark", (0.0, SPAN))

    def show(self, kept: Curves, now: Curves, joint: int) -> None:
        """Draw the error of a joint in both."""
        longest = max(kept, now, key=lambda curves: curves.time.size)
        if not longest.time.size:
            return
        drawn = [_MILLI * _stretched(curves, joint, longest.time) for curves in (kept, now)]
        self._plot.data = (longest.time, *drawn)


def _stretched(curves: Curves, joint: int, time: Array) -> Array:
    """The error of a joint at these times; where the curve is shorter, its last value (the plot cannot show gaps)."""
    if not curves.time.size:
        return np.zeros(time.size)
    values = curves.values[:, 0, joint]
    return np.append(values, np.full(max(0, time.size - values.size), values[-1]))[: time.size]


def _curve(label: str, stroke: str, width: float = 1.25) -> uplot.Series:
    return uplot.Series(label=label, stroke=stroke, width=width, points={"show": False})


def _plot(
    gui: GuiApi, curves: int, series: list[uplot.Series], title: str, span: tuple[float, float]
) -> GuiUplotHandle:
    return gui.add_uplot(
        data=(_NOTHING + span[1], *np.zeros((curves, _NOTHING.size))),
        series=tuple(series),
        title=title,
        scales={"x": uplot.Scale(time=False, range=span), "y": uplot.Scale(auto=True)},
        axes=_AXES,
        legend={"show": False},
        height=_HEIGHT,
    )
