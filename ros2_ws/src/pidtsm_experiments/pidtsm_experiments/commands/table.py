"""The metrics of a run as a table on the terminal."""

from collections.abc import Iterator, Mapping
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from pidtsm_core.recording.outcome import OF_TRACKING, RAN_AWAY, what_happened
from pidtsm_core.units import alike, joint_units
from pidtsm_studies.reports.labels import value_text

ROWS = (
    ("rmse", "RMSE", "{position}"),
    ("eci", "ECI, mean |effort|", "{effort}"),
    ("steady_state_error", "steady-state error", "{position}"),
    ("settling_time", "settling time", "s"),
    ("recovery_time", "recovery time", "s"),
    ("torque_variation", "effort variation", "{effort}"),
    ("torque_variation_rate", "effort variation rate", "{effort}/s"),
    ("torque_jumps", "effort jumps", ""),
    ("saturation", "saturated", "%"),
    ("time_at_effort_limit", "at the effort limit", "s"),
    ("time_at_rate_limit", "at the rate limit", "s"),
    ("adaptive_gain", "adaptive gain, last", ""),
)
"""Key, name and unit of each metric."""
FACTOR = {"saturation": 100.0}
"""Factors of metrics whose unit in tables is another one."""
ONLY_IF_ANY = ("time_at_effort_limit", "time_at_rate_limit")
"""Metrics that are shown only if they are not 0."""
_LABELS, _CELL = 35, 10
"""Widths of the metrics with their units, and of a value, characters."""


def metrics_tables(metrics: Mapping[str, Any], width: int = 80) -> Iterator[Table]:
    """The metrics with one column per joint, in tables of joints with the same units.

    Args:
        metrics: as in metrics.json.
        width: largest width of a table that has more than one joint, characters.
    """
    joints = metrics["joints"]
    columns = (width - _LABELS) // (max(_CELL, *map(len, joints)) + 3)
    labels = [str(metrics[key]) for key in ("scenario", "law", "clock") if metrics[key] is not None]
    run = f"{_number(metrics['duration'])} s, {metrics['samples']} samples"
    title: str | None = escape(": ".join(filter(None, (", ".join(labels), run))))
    units = joint_units(metrics["slides"], len(joints))
    for group in alike(units, max(1, columns)):
        table = Table(title=title, title_style="bold", box=box.SIMPLE_HEAD)
        title = None
        table.add_column("metric")
        table.add_column("unit")
        for joint in group:
            table.add_column(escape(joints[joint]), justify="right")
        for key, label, unit in ROWS:
            if key in metrics and (key not in ONLY_IF_ANY or any(metrics[key])):
                cells = _cells(metrics, key)
                of_group = unit.format(**units[group[0]]._asdict())
                table.add_row(label, of_group, *(cells[joint] for joint in group))
        yield table


def _cells(metrics: Mapping[str, Any], key: str) -> list[str]:
    """A metric of each joint; no tracking metrics if the arm ran away, since the numbers would be misleading."""
    if metrics["outcome"] == RAN_AWAY and key in OF_TRACKING:
        return [f"[bold red]{RAN_AWAY}[/]"] * len(metrics[key])
    return [_number(value, FACTOR.get(key, 1.0)) for value in metrics[key]]


def print_metrics(metrics: Mapping[str, Any], console: Console | None = None) -> None:
    """Print the tables, the timing and everything unusual; plain text if the output is not a terminal.

    Args:
        metrics: as in metrics.json.
        console: output, by default standard output.
    """
    console = console or Console()
    for table in metrics_tables(metrics, console.width):
        console.print(table)
    timing = metrics["timing"]
    tick = " / ".join(_number(timing["compute_time"][key], 1e6) for key in ("p50", "p99", "max"))
    console.print(
        f"{_number(timing['rate'])} Hz, longest period {_number(timing['period_max'], 1e3)} ms, "
        f"compute time {tick} us (p50 / p99 / max)",
        highlight=False,
    )
    for text in what_happened(metrics):
        console.print(text, style="bold red", highlight=False, markup=False)


def _number(value: float | None, factor: float = 1.0) -> str:
    return "-" if value is None else value_text(value if factor == 1.0 else factor * value)
