"""What a page shows of the controller: state, loop, metrics, curves and the last events."""

from collections import deque
from collections.abc import Sequence
from html import escape
from itertools import takewhile
from typing import NamedTuple

import numpy as np
from viser import GuiTabHandle

from pidtsm_core.arrays import Array
from pidtsm_core.control.findings import What, statements
from pidtsm_core.recording.metric import MEAN_EFFORT, RMSE, Metric
from pidtsm_core.signals import Signal
from pidtsm_core.units import JointUnits, either
from pidtsm_core.written import THIN, Scale, scale, scaled, signed
from pidtsm_experiments.live.desk import Desk
from pidtsm_experiments.live.history import History, Measurement
from pidtsm_experiments.live.motion import Moving
from pidtsm_experiments.live.plots import SHOWN, Comparison, Plots, color
from pidtsm_experiments.live.stream import Batch
from pidtsm_experiments.live.words import AMBER, GREEN, OLD, Sentence, badge, loop, mode
from pidtsm_msgs.msg import ControllerState

_PANEL = 380
"""Width of the curves, px: on a tablet of 1024 px there is room for the arm beside them."""
_LISTED = 3
"""Events of the curves that are listed above them."""
_MARKS = 100
"""Largest number of events on the curves."""


class Status:
    """What the controller does, and whether the arm is real, above everything else."""

    def __init__(self, desk: Desk) -> None:
        """Add it to the current container."""
        self._desk = desk
        self._html = desk.server.gui.add_html("")

    def show(self, newest: ControllerState | None, name: str) -> None:
        """Show the state; `newest`: last state of the controller, or None; `name`: of the arm."""
        system, nodes = self._desk.system, self._desk.nodes
        known = system.known(newest, nodes.ended("controller") if nodes is not None else "")
        occupied = self._desk.occupied
        sentence = Sentence(occupied[:1].upper() + occupied[1:], AMBER) if occupied else mode(known)
        real = "REAL ARM" if system.source.driver else "REAL ARM, not seen yet"
        kind = badge("SIMULATED", GREEN) if system.simulated else badge(real, AMBER)
        self._html.content = (
            f'<div id="status" style="padding:0.5em 0.75em;line-height:1.6">{kind} <b>{escape(name)}</b><br>'
            f'<span style="color:{sentence.color};font-weight:600">{escape(sentence.text)}</span><br>'
            f'<span style="font-size:0.8em;opacity:0.75">{loop(known)}</span></div>'
        )


class Mark(NamedTuple):
    """An event on the curves."""

    time: float  # on the axis of the curves, s
    text: str


class Watching:
    """Curves and metrics; the curves are in a panel of their own."""

    def __init__(self, desk: Desk, joints: Sequence[str], units: Sequence[JointUnits], tab: GuiTabHandle) -> None:
        """Add the controls to a tab, and the panel."""
        self._desk, self._joints, self._units, gui = desk, list(joints), list(units), desk.server.gui
        self._history, self._measured, self._kept = History(), Measurement(), Measurement()
        self._marks: deque[Mark] = deque(maxlen=_MARKS)
        self._seen: tuple[str, str] | None = None
        self.moving: Moving | None = None
        named = {
            "position": either(f"m{unit.position}" for unit in units),
            "effort": either(unit.effort for unit in units),
        }
        panel = gui.add_panel()
        with panel.add_tab("Curves"):
            gui.add_html(_legend(joints))
            self._paused = gui.add_checkbox("pause", False, hint="stop drawing; the system goes on")
            self._listed = gui.add_html("")
            self._plots = Plots(gui, joints, named)
        with panel.add_tab("A / B"):
            gui.add_markdown("Keep a curve as A, change a setting, and compare.")
            kept = "A: the error since the mark; then the motion starts again"
            desk.button("Keep as A, start again", self._keep, kept, moves=True)
            self._joint = gui.add_dropdown("joint", tuple(joints), hint="joint whose error is drawn")
            self._comparison = Comparison(gui, named)
            self._compared = gui.add_html("")
        panel.dock_left()
        panel.set_width(_PANEL)
        with tab:
            self._metrics = gui.add_html("")
            desk.button("Mark", self._mark, "measure RMSE and ECI from now on")
            again = "start the built-in motion again, and measure from now on"
            desk.button("Start the motion again, and mark", self._again, again, moves=True)
            self._found = gui.add_html("")
            self._events = gui.add_html("")
        self._told: set[tuple[What, str]] = set()

    def add(self, batch: Batch) -> None:
        """Take new samples."""
        self._history.add(batch.stamps, batch.values[:, list(SHOWN)])
        self._measured.add(batch.stamps, batch.values[:, Signal.POSITION_ERROR], batch.values[:, Signal.EFFORT])

    def draw(self) -> None:
        """Draw the curves."""
        if not self._paused.value:
            silence, curves = self._desk.system.silence, self._history.curves()
            if curves.time.size:
                self._mark_events(float(curves.time[-1]))
            self._plots.show(curves, silence if silence > OLD else 0.0, [mark.time for mark in self._marks])
            if self._joint.value in self._joints:
                joint = self._joints.index(self._joint.value)
                self._comparison.show(self._kept.error(), self._measured.error(), joint)

    def _mark_events(self, now: float) -> None:
        """Give each new event its place on the curves, and list the last ones; `now`: time of the curves, s."""
        if self._marks and self._marks[-1].time > now:  # The clock was set, and the curves began anew.
            self._marks.clear()
        new = list(takewhile(lambda event: event is not self._seen, self._desk.system.events))
        self._seen = self._desk.system.events[0] if self._desk.system.events else None
        self._marks.extend(Mark(now, text) for _, text in reversed(new))
        lines = "".join(
            f'<div style="overflow:hidden;text-overflow:ellipsis;white-space:nowrap" title="{escape(mark.text)}">'
            f"│ {signed(mark.time - now, 2)}{THIN}s {escape(mark.text)}</div>"
            for mark in list(self._marks)[-_LISTED:][::-1]
        )
        # From the first event on the height is constant, so that the plots do not move.
        style = f"padding:0 0.75em;font-size:0.8em;line-height:1.3;height:{1.3 * _LISTED}em"
        self._listed.content = f'<div id="marks" style="{style}">{lines}</div>' if self._marks else ""

    def show(self) -> None:
        """Show metrics and events."""
        now, kept = self._measured, self._kept
        self._metrics.content = metrics_table(
            self._joints, self._units, [("RMSE", RMSE, now.rmse), ("ECI", MEAN_EFFORT, now.eci)]
        )
        if kept.samples and now.samples:
            columns = [("RMSE of A", RMSE, kept.rmse), ("RMSE", RMSE, now.rmse)]
            columns += [("ECI of A", MEAN_EFFORT, kept.eci), ("ECI", MEAN_EFFORT, now.eci)]
            self._compared.content = metrics_table(self._joints, self._units, columns)
        self._tell_found()
        lines = "".join(f"<div>{time} {escape(text)}</div>" for time, text in self._desk.system.events)
        self._events.content = f'<div id="events" style="padding:0.5em 0.75em;font-size:0.8em">{lines}</div>'

    def _tell_found(self) -> None:
        """Show what the controller has found out; what is new is an event, too."""
        stated = statements(self._desk.system.found)
        for each in stated:
            if (each.what, each.joint) not in self._told:
                self._told.add((each.what, each.joint))
                self._desk.system.note(each.text)
        lines = "".join(f"<div>{escape(each.text)}</div>" for each in stated)
        style = "padding:0.5em 0.75em 0;font-size:0.8em;overflow-wrap:anywhere"
        self._found.content = f'<div id="found" style="{style}"><b>Found out</b>{lines}</div>' if stated else ""

    async def _mark(self) -> None:
        self._measured = Measurement()
        self._desk.system.note("mark")

    async def _again(self) -> None:
        if self.moving is not None:
            await self.moving.begin()
        await self._mark()

    async def _keep(self) -> None:
        self._kept = self._measured
        await self._again()


def _legend(joints: Sequence[str]) -> str:
    names = " ".join(f'<span style="color:{color(i)};font-weight:600">{escape(j)}</span>' for i, j in enumerate(joints))
    return f'<div style="padding:0.25em 0.75em">{names}</div>'


def metrics_table(
    joints: Sequence[str], units: Sequence[JointUnits], columns: Sequence[tuple[str, Metric, Array]]
) -> str:
    """Metrics per joint since the mark, as HTML.

    Args:
        joints: names.
        units: of each joint.
        columns: heading, metric and values (SI, shape (joints,)) of each; one without values is left out. Those of the
            same metric have the same unit.
    """
    filled = [column for column in columns if np.size(column[2]) == len(joints)]
    shown = {
        metric: _scales(metric, np.max([values for _, each, values in filled if each is metric], axis=0), units)
        for _, metric, _ in filled
    }
    head = "".join(
        f'<th style="text-align:right;padding-left:1em">{heading}<br>'
        f'<span style="font-weight:400">{either(each.unit for each in shown[metric].values())}</span></th>'
        for heading, metric, _ in filled
    )
    rows = "".join(
        f'<tr><td style="color:{color(i)};font-weight:600">{escape(joint)}</td>'
        + "".join(
            f'<td style="text-align:right;padding-left:1em;white-space:nowrap">'
            f"{scaled(float(values[i]), shown[metric][metric.unit_of(units[i])])}</td>"
            for _, metric, values in filled
        )
        + "</tr>"
        for i, joint in enumerate(joints)
    )
    return f'<table style="margin:0.5em 0.75em;font-size:0.85em"><tr><th>since the mark</th>{head}</tr>{rows}</table>'


def _scales(metric: Metric, largest: Array, units: Sequence[JointUnits]) -> dict[str, Scale]:
    """A scale for each SI unit, which fits the largest value: it changes less often than one that fits most values."""
    si = [metric.unit_of(each) for each in units]
    return {
        unit: scale([max(float(largest[i]) for i in range(len(si)) if si[i] == unit)], unit)
        for unit in dict.fromkeys(si)
    }
