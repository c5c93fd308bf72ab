"""Scrolling curves: what the controller computes, per joint, over the last seconds."""

from collections.abc import Sequence

import numpy as np
from viser import GuiApi, GuiUplotHandle, uplot

from pidtsm_core.arrays import Array
from pidtsm_core.signals import Signal
from pidtsm_experiments.live.history import SPAN, Curves
from pidtsm_studies.reports.styles import SERIES

SHOWN = {
    Signal.POSITION_ERROR: "error e in {position}",
    Signal.EFFORT: "effort τ in {effort}",
    Signal.SLIDING_VARIABLE: "sliding variable s, in thousandths",
    Signal.ADAPTIVE_GAIN: "adaptive gain Υ",
}
"""The signals with a plot, and its title with the units of the joints."""
_FIRST = (Signal.POSITION_ERROR, Signal.EFFORT)
"""The signals that every user watches; the others are folded."""
_MILLI = 1e3
_SCALED = (Signal.POSITION_ERROR, Signal.SLIDING_VARIABLE)
"""Signals drawn in thousandths: the labels of the axes have three decimals."""
_TALL, _LOW = 210, 150
"""Heights of the first plots and of the others, px."""
_NOTHING = np.array([-SPAN, 0.0])
_WINDOWS = ("2 s", "5 s", "10 s", f"{SPAN:g} s")
"""Lengths of the time axes."""
_ALL = "all joints"
_AXES: tuple[uplot.Axis, ...] = (
    {"size": 24},
    {"size": 52},
    # An empty axis above: otherwise the highest label of the vertical axis is cut off.
    {"scale": "x", "side": 0, "size": 8, "stroke": "transparent", "ticks": {"show": False}, "grid": {"show": False}},
)
EVENTS = "events"
"""Label of the line of the events: a spike through the whole plot at each."""
_MARK = "#7048e8"
_BEYOND = 10.0
"""How far the line of the events lies beyond the curves, as a multiple of their range."""


def color(joint: int) -> str:
    """Colour of a joint's curves, as in the reports."""
    return SERIES[joint % len(SERIES)].light


class Plots:
    """One plot for each of `SHOWN`, with one curve per joint, over the time before now."""

    def __init__(self, gui: GuiApi, joints: Sequence[str], units: dict[str, str]) -> None:
        """Add the plots to the current container; `units`: of positions and efforts."""
        self._joints = list(joints)
        self._joint = gui.add_dropdown("joint shown", (_ALL, *joints), hint="whose curves are drawn")
        self._window = gui.add_dropdown(
            "time window", _WINDOWS, initial_value=_WINDOWS[-1], hint="length of the curves"
        )
        self._plots: dict[Signal, GuiUplotHandle] = {}
        for signal in _FIRST:
            self._plots[signal] = self._add(gui, signal, units, _TALL)
        with gui.add_folder("variables of the law", expand_by_default=False):
            for signal in SHOWN:
                if signal not in _FIRST:
                    self._plots[signal] = self._add(gui, signal, units, _LOW)
        self._joint.on_update(lambda _: self._choose())
        self._window.on_update(lambda _: self._choose())

    def _add(self, gui: GuiApi, signal: Signal, units: dict[str, str], height: int) -> GuiUplotHandle:
        return _plot(gui, len(self._joints) + 1, self._series(), SHOWN[signal].format(**units), (-SPAN, 0.0), height)

    def _series(self) -> list[uplot.Series]:
        chosen = self._joint.value
        curves = [_curve(joint, i, shown=chosen in (_ALL, joint)) for i, joint in enumerate(self._joints)]
        return [uplot.Series(label="s"), *curves, uplot.Series(label=EVENTS, stroke=_MARK, width=1.0, auto=False)]

    def _choose(self) -> None:
        """Draw the chosen joint over the chosen time."""
        window = self._window.value if self._window.value in _WINDOWS else _WINDOWS[-1]  # A page may send anything.
        length = float(window.split()[0])
        for plot in self._plots.values():
            plot.series = tuple(self._series())
            plot.scales = _scales((-length, 0.0))

    def show(self, curves: Curves, silence: float = 0.0, events: Sequence[float] = ()) -> None:
        """Draw the curves; their signals are those of `SHOWN`. They go on to the left when nothing follows.

        Args:
            curves: of every joint.
            silence: time since the last point, s.
            events: when something happened, on the time of the curves, s.
        """
        if not curves.time.size:
            return
        time = curves.time - curves.time[-1] - silence
        for i, signal in enumerate(SHOWN):
            scale = _MILLI if signal in _SCALED else 1.0
            values = np.ascontiguousarray(scale * curves.values[:, i].T)
            self._plots[signal].data = (time, *values, _spikes(curves.time, events, values))


def _spikes(time: Array, events: Sequence[float], values: Array) -> Array:
    """A line that crosses the whole plot at each event and is outside it elsewhere, shape (points,)."""
    low, high = float(values.min()), float(values.max())
    far = _BEYOND * (high - low or 1.0)
    line = np.full(time.size, low - far)
    inside = [event for event in events if time[0] <= event <= time[-1]]
    line[np.searchsorted(time, inside)] = high + far
    return line


class Comparison:
    """The error of one joint since a mark, beside the kept curve A."""

    def __init__(self, gui: GuiApi, units: dict[str, str]) -> None:
        """Add the plot to the current container; `units`: of positions and efforts."""
        series = [uplot.Series(label="s"), _curve("A", 1, 2.0), _curve("now", 0)]
        title = "error since the mark in {position}".format(**units)
        self._plot = _plot(gui, 2, series, title, (0.0, SPAN), _LOW)

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


def _curve(label: str, style: int, width: float = 1.25, shown: bool = True) -> uplot.Series:
    dash = SERIES[style % len(SERIES)].dashes
    look = uplot.Series(label=label, stroke=color(style), width=width, points={"show": False}, show=shown)
    return {**look, "dash": dash} if dash else look


def _scales(span: tuple[float, float]) -> dict[str, uplot.Scale]:
    return {"x": uplot.Scale(time=False, range=span), "y": uplot.Scale(auto=True)}


def _plot(
    gui: GuiApi, curves: int, series: list[uplot.Series], title: str, span: tuple[float, float], height: int
) -> GuiUplotHandle:
    return gui.add_uplot(
        data=(_NOTHING + span[1], *np.zeros((curves, _NOTHING.size))),
        series=tuple(series),
        title=title,
        scales=_scales(span),
        axes=_AXES,
        legend={"show": False},
        height=height,
    )
