"""The metrics of a run as a table on the terminal."""

from collections.abc import Mapping
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pidtsm_core.recording.metric import METRICS, Metric
from pidtsm_core.recording.outcome import FOLLOWED, OF_TRACKING, RAN_AWAY, is_rough, verdict, what_happened
from pidtsm_core.units import joint_units
from pidtsm_studies.reports.labels import value_text

_CELL = 9
"""Largest width of a value, characters; headings wrap."""


def metrics_table(metrics: Mapping[str, Any], width: int = 80) -> Table:
    """The metrics with one row per joint, and as many columns as fit.

    Args:
        metrics: as in metrics.json.
        width: largest width of the table, characters; at least one metric is shown.
    """
    joints = metrics["joints"]
    units = joint_units(metrics["slides"], len(joints))
    mixed = len({*units}) > 1
    labels = [str(metrics[key]) for key in ("scenario", "law", "clock") if metrics[key] is not None]
    run = f"{_number(metrics['duration'])} s, {metrics['samples']} samples"
    title = escape(": ".join(filter(None, (", ".join(labels), run))))
    table = Table(title=title, title_style="bold", box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1))
    table.add_column("joint", no_wrap=True)
    taken = max(5, *map(len, joints))
    if mixed:
        table.add_column("units", no_wrap=True)
        taken += 10
    known = [m for m in METRICS if m.key in metrics and (not m.only_if_any or any(metrics[m.key]))]
    columns = known[: max(1, (width - taken - 3) // (_CELL + 2))]
    for metric in columns:
        unit = "" if mixed and "{" in metric.unit else metric.unit_of(units[0])
        table.add_column(f"{metric.heading}\n{unit}".strip(), justify="right", vertical="bottom", max_width=_CELL)
    for j, joint in enumerate(joints):
        of_joint = [f"{units[j].position}, {units[j].effort}"] if mixed else []
        table.add_row(escape(joint), *of_joint, *(_cell(metrics, metric, j) for metric in columns))
    return table


def _cell(metrics: Mapping[str, Any], metric: Metric, joint: int) -> str:
    """A metric of a joint; no tracking metrics if the arm ran away, since the numbers would be misleading."""
    if metrics["outcome"] == RAN_AWAY and metric.key in OF_TRACKING:
        return f"[bold red]{RAN_AWAY}[/]"
    return _number(metrics[metric.key][joint], metric.factor)


def print_metrics(metrics: Mapping[str, Any], console: Console | None = None) -> None:
    """Print the table, the timing, everything unusual and the verdict; plain text if the output is not a terminal.

    Args:
        metrics: as in metrics.json.
        console: output, by default standard output.
    """
    console = console or Console()
    console.print(metrics_table(metrics, console.width))
    timing = metrics["timing"]
    if timing["compute_time"]["p50"] is not None:  # Only nodes have one.
        tick = " / ".join(_number(timing["compute_time"][key], 1e6) for key in ("p50", "p99", "max"))
        console.print(
            f"{_number(timing['rate'])} Hz, longest period {_number(timing['period_max'], 1e3)} ms, "
            f"compute time {tick} us (p50 / p99 / max)",
            highlight=False,
        )
    judgement = verdict(metrics)
    for text in what_happened(metrics):
        if text != judgement:
            console.print(text, style="red", highlight=False, markup=False)
    color = "red" if metrics["outcome"] != FOLLOWED else "yellow" if is_rough(metrics) else "green"
    console.print(judgement, style=f"bold {color}", highlight=False, markup=False)


def _number(value: float | None, factor: float = 1.0) -> str:
    return "-" if value is None else value_text(value if factor == 1.0 else factor * value)
