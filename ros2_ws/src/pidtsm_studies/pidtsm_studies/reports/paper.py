"""Runs that are compared, for a paper: a LaTeX table with intervals, vector figures, and the data that they draw."""

import csv
import io
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

from pidtsm_core.arrays import Array
from pidtsm_core.parameters.files import Settings
from pidtsm_core.recording import Recording
from pidtsm_core.recording.latex import NOTHING, cell, escaped, spread, table
from pidtsm_core.recording.metric import METRICS
from pidtsm_core.units import joint_units
from pidtsm_studies.article.claims import Run
from pidtsm_studies.reports.figures import decimated
from pidtsm_studies.reports.matrix import metric_value

STYLE = "pidtsm_studies.paper"
"""Name for `matplotlib.style.use`, which finds the file in this package."""
_SEED = "seed"
_PANEL = 1.5  # inch, height
_WIDTH = 3.5
QUANTITIES: Mapping[str, tuple[str, Callable[[Recording], Array]]] = {
    "position": ("$q$", lambda run: run.position),
    "error": ("$e$", lambda run: run.error),
    "effort": (r"$\tau$", lambda run: run.effort),
}
"""Symbol and values, shape (samples, joints), of what is drawn, by the name of the figure."""


def groups(runs: Mapping[str, Run], parameters: Mapping[str, Settings]) -> dict[str, list[str]]:
    """Names of the runs that are repetitions of each other, by a label: all parameters but the seed are the same.

    A run alone has its name as label; several have that of their law, or of the first one if another group has it.

    Args:
        runs: by name.
        parameters: of the nodes, by run; a run whose parameters are not known is a group of its own.
    """
    found: dict[str, list[str]] = {}
    for name in runs:
        nodes = parameters.get(name) or {}
        values = {(node, key): each for node in nodes for key, each in nodes[node].items() if key != _SEED}
        found.setdefault(repr(sorted(values.items())) if values else name, []).append(name)
    labels: dict[str, list[str]] = {}
    for names in found.values():
        law = runs[names[0]][0].law
        alone = len(names) == 1 or not law or law in labels or law in runs
        labels[names[0] if alone else str(law)] = names
    return labels


def comparison_table(runs: Mapping[str, Run], parameters: Mapping[str, Settings], comment: str = "") -> str:
    """A LaTeX table with booktabs: a column per group of `groups`, with mean and 95 % interval if it has several runs.

    Args:
        runs: by name, of the same joints.
        parameters: see `groups`.
        comment: lines at the top.
    """
    columns = groups(runs, parameters)
    first = next(iter(runs.values()))[1]
    units = joint_units(first["slides"], len(first["joints"]))
    rows = []
    for metric in METRICS:
        head = metric.name
        for j, joint in enumerate(first["joints"]):
            values = [[metric_value(runs[name][1], metric.key, j) for name in names] for names in columns.values()]
            spreads = [spread([np.nan if v is None else metric.factor * v for v in each]) for each in values]
            cells = [cell(each.mean, each.half) for each in spreads]
            if all(each == NOTHING for each in cells) or (metric.only_if_any and not any(e.mean for e in spreads)):
                continue
            rows.append([escaped(head), escaped(joint), _unit(metric.unit_of(units[j])), *cells])
            head = ""
    heads = [escaped(name) + (f" ($n = {len(names)}$)" if len(names) > 1 else "") for name, names in columns.items()]
    return table(["metric", "joint", "unit", *heads], rows, 3, comment)


def _unit(unit: str) -> str:
    return escaped(unit).replace("N m", r"N\,m")


def write_paper_figures(runs: Mapping[str, Run], parameters: Mapping[str, Settings], folder: Path) -> list[Path]:
    """Draw `QUANTITIES` of all runs as PDF and SVG, and write what is drawn beside it as CSV; returns the files.

    The runs of a group look alike. The CSV has the columns run, joint, unit, time (s) and that of the quantity.

    Args:
        runs: by name, of the same joints.
        parameters: see `groups`.
        folder: created if missing.
    """
    folder.mkdir(parents=True, exist_ok=True)
    columns, files = groups(runs, parameters), []
    with mpl.style.context(STYLE):
        for name, (symbol, values_of) in QUANTITIES.items():
            lines = list(_lines(runs, values_of))
            figure = _drawn(runs, columns, lines, symbol)
            for suffix, metadata in (("pdf", {"CreationDate": None}), ("svg", {"Date": None})):
                files.append(folder / f"{name}.{suffix}")
                figure.savefig(files[-1], metadata=metadata)
            files.append(folder / f"{name}.csv")
            files[-1].write_text(_csv(name, lines), encoding="utf-8")
    return files


_Line = tuple[str, int, str, str, Array, Array]
"""Run, number, name and unit of a joint, time (s) and values."""


def _lines(runs: Mapping[str, Run], values_of: Callable[[Recording], Array]) -> Iterator[_Line]:
    for name, (recording, _) in runs.items():
        values = values_of(recording)
        for j, joint in enumerate(recording.joints):
            unit = recording.units[j].effort if values is recording.effort else recording.units[j].position
            yield name, j, joint, unit, *decimated(recording.time, values[:, j])


def _drawn(runs: Mapping[str, Run], columns: Mapping[str, list[str]], lines: list[_Line], symbol: str) -> Figure:
    joints = len(next(iter(runs.values()))[0].joints)
    figure = Figure(figsize=(_WIDTH, 0.4 + _PANEL * joints))
    panels = figure.subplots(joints, sharex=True, squeeze=False)[:, 0]
    looks: list[Any] = list(mpl.rcParams["axes.prop_cycle"])
    styles = {run: (looks[i % len(looks)], label) for i, (label, names) in enumerate(columns.items()) for run in names}
    seen = set()
    for run, j, joint, unit, time, values in lines:
        look, label = styles[run]
        panels[j].plot(time, values, **look, label=None if (j, label) in seen else _plain(label))
        panels[j].set_ylabel(f"{_plain(joint)}\n{symbol} ({unit})")
        seen.add((j, label))
    panels[-1].set_xlabel("time (s)")
    panels[0].legend()
    return figure


def _plain(name: str) -> str:
    """A name in which Matplotlib finds no mathematics."""
    return name.replace("$", r"\$")


def _csv(name: str, lines: list[_Line]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["run", "joint", "unit", "time", name])
    for run, _, joint, unit, time, values in lines:
        pairs = zip(time.tolist(), values.tolist(), strict=True)
        writer.writerows([run, joint, unit, repr(t), repr(v)] for t, v in pairs)
    return text.getvalue()
