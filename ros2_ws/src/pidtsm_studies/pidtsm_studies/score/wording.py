"""Scores as text, for the tables of the terminal, the page and the document."""

import math
from collections.abc import Sequence
from pathlib import Path

from pidtsm_studies.limit.known import above_limit
from pidtsm_studies.reports.labels import label
from pidtsm_studies.score.intervals import Difference
from pidtsm_studies.score.results import Curve, Entry, Outcome

COLUMNS = (
    "controller",
    "score",
    "RMSE, ideal",
    "RMSE, 14 bit and 1 ms",
    "ECI",
    "effort variation",
    "worst criterion",
)
"""Columns of the table of an arm, in the order of `cells`."""


COLUMNS_ON_HARDWARE = (
    "controller",
    "score",
    "of what is possible",
    "behind the best",
    "RMSE, steady",
    "RMSE, transient",
    "effort variation",
    "worst criterion",
)
"""Likewise of a table on hardware, see `cells_on_hardware`."""


def title(entry: Entry) -> str:
    """Name of the controller in tables."""
    return label(entry.law) + entry.name.removeprefix(entry.law) if entry.name.startswith(entry.law) else entry.name


def arm_of(entry: Entry) -> str:
    """Name of the arm in tables and ids."""
    return Path(entry.task.robot).stem


def score_text(entry: Entry) -> str:
    """Score with its interval, in per cent."""
    low, high = entry.interval
    return f"{100.0 * entry.score:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})"


def share_text(outcome: Outcome) -> str:
    """Share of a criterion, in per cent."""
    return f"{100.0 * outcome.share:.0f} %"


def failure_text(outcome: Outcome) -> str:
    """Where a criterion fails first, of which joint and why; empty: nowhere."""
    return "; ".join(_failure_text(curve) for curve in outcome.curves if curve.failure is not None)


def _failure_text(curve: Curve) -> str:
    assert curve.failure is not None
    value, joint, reason = curve.failure
    cause = {"error": f"error of {joint}", "roughness": f"rough effort of {joint}"}.get(reason, reason)
    return f"{cause} at {value:g} {curve.range.unit}".rstrip()


def cells(entry: Entry) -> list[str]:
    """A row of the table of an arm, see `COLUMNS`."""
    return [
        title(entry),
        score_text(entry),
        _number(entry, "ideal", "rmse") + _above_limit(entry),
        _number(entry, "hardware", "rmse"),
        _number(entry, "hardware", "eci"),
        _number(entry, "hardware", "torque_variation"),
        f"{entry.worst.criterion.name.replace('_', ' ')} ({share_text(entry.worst)})",
    ]


def cells_on_hardware(entry: Entry, oracle: Entry | None, behind: Difference | None) -> list[str]:
    """A row of the table of an arm on hardware, see `COLUMNS_ON_HARDWARE`.

    Args:
        entry: of the row; RMSE and effort variation are means over the motions.
        oracle: of the table; None: there is none.
        behind: what the best controller of the table has more; None: nothing is compared.
    """
    points = (
        "" if behind is None else f"{100.0 * behind.mean:.1f} ({100.0 * behind.low:.1f} to {100.0 * behind.high:.1f}"
    )
    return [
        title(entry),
        score_text(entry),
        f"{100.0 * entry.score / oracle.score:.0f} %" if oracle and oracle.score else "",
        f"{points}), p = {behind.p:.2g}" if behind is not None else "",
        *(_mean(entry, name) for name in ("steady_rmse", "transient_rmse", "torque_variation")),
        f"{entry.worst.criterion.name.replace('_', ' ')} ({share_text(entry.worst)})",
    ]


def _mean(entry: Entry, metric: str) -> str:
    """Mean of a metric over the nominal runs that did not diverge."""
    found = [combined(metric, run[metric]) for run in entry.nominal.values() if run is not None]
    return f"{math.fsum(found) / len(found):.3g}" if found else "diverged"


def combined(metric: str, values: Sequence[float]) -> float:
    """One number for all joints: the root of the sum of squares of RMSE, the sum of ECI and effort variation."""
    return math.hypot(*values) if metric.endswith("rmse") else math.fsum(values)


def _number(entry: Entry, run: str, metric: str) -> str:
    found = entry.nominal[run]
    if found is None:
        return "diverged"
    return f"{combined(metric, found[metric]):.3g}{'' if entry.succeeds[run] else ' (failed)'}"


def _above_limit(entry: Entry) -> str:
    """By how much the RMSE of each joint exceeds what any controller can reach, if that is known for this arm."""
    found = entry.nominal["ideal"]
    text = "" if found is None else above_limit(entry.task.robot, found["rmse"])
    return f" ({text})" if text else ""
