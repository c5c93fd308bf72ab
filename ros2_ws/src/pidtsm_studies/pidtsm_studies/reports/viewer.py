"""What moves on a page of runs: the arm, its curves over the same time, and the marks of what happened."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, TypeAlias

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.recording import Recording
from pidtsm_core.robots import find_robot
from pidtsm_core.written import number
from pidtsm_studies.article.claims import Run
from pidtsm_studies.reports.animation import RATE, animation, moments
from pidtsm_studies.reports.curves import QUANTITIES, Quantity, curves
from pidtsm_studies.reports.events import Event
from pidtsm_studies.reports.labels import CASES, Entry
from pidtsm_studies.reports.page import Section
from pidtsm_studies.reports.styles import looks

Cases: TypeAlias = Mapping[str, Mapping[str, Run]]
"""Runs that are drawn over each other, by case, and by law or name."""
Happened: TypeAlias = Mapping[tuple[str, str], Sequence[Event]]
"""Events by case, and by law or name."""


def case_name(case: str) -> str:
    """Name of a case in headings."""
    return CASES.get(case, case)


def viewer_data(
    cases: Cases,
    entries: Mapping[str, Entry],
    happened: Happened,
    joint: int | None,
    quantities: Sequence[Quantity] = QUANTITIES,
) -> dict[str, Any]:
    """Data for viewer.js.

    Args:
        cases: runs of arms with the same joints, at least one.
        entries: legend, by law or name.
        happened: events of the runs.
        joint: index of the joint that is chosen at first; None: all.
        quantities: what is drawn.

    Returns:
        Plain data for JSON. ``arm``: see `animation`, or None with a ``reason``. ``cases``: by case its curves, see
        `curves`. ``runs``: under ``CASE LAW``, label, look, duration, events, error and effort at ``rate``, and the
        largest effort of each joint (N m or N), by which its arc is drawn.
    """
    arm, reason = None, ""
    try:
        arm = animation(cases)
    except ParameterError as error:
        reason = str(error)
    first = next(run for runs in cases.values() for run, _ in runs.values())
    runs = {
        f"{case} {key}": {
            **run_data(case, key, run.time, entries[key]),
            "largest": _largest(run),
            "events": [event.data() for event in happened.get((case, key), ())],
            **moments(run),
        }
        for case, runs in cases.items()
        for key, (run, _) in runs.items()
    }
    drawn = {case: curves({key: run for key, (run, _) in runs.items()}, quantities) for case, runs in cases.items()}
    units = [list(units) for units in first.units]
    return assembled(first.joints, units, drawn, runs, joint) | {"arm": arm, "reason": reason}


def run_data(case: str, key: str, time: Array, entry: Entry) -> dict[str, Any]:
    """What is the same for every kind of run.

    Args:
        case: of the run.
        key: law or name of the run.
        time: of its samples, s, shape (samples,).
        entry: of the legend.
    """
    return {
        "key": key,
        "case": case,
        "label": entry.label,
        **looks(entry.style),
        "start": float(time[0]),
        "duration": float(time[-1] - time[0]),
    }


def assembled(
    joints: Sequence[str],
    units: Sequence[Sequence[str]],
    drawn: Mapping[str, Mapping[str, Any]],
    runs: Mapping[str, Mapping[str, Any]],
    joint: int | None,
) -> dict[str, Any]:
    """Data for viewer.js without an arm; see `viewer_data`."""
    return {
        "rate": RATE,
        "joints": list(joints),
        "units": units,
        "heads": ["error", "effort"],
        "joint": joint,
        "arm": None,
        "reason": "",
        "cases": drawn,
        "runs": runs,
        "joint_looks": [looks(j) for j in range(len(joints))],
    }


def viewer_section(
    data: Mapping[str, Any],
    choice: str = "Laws",
    heading: str = "Motion, error and effort",
    full: str = "the limit",
) -> Section:
    """The arm, error and effort.

    Args:
        data: see `viewer_data`.
        choice: what the runs are called.
        heading: of the section.
        full: the effort that is drawn as a full turn, in words.
    """
    runs = {run["key"]: run for run in data["runs"].values()}
    content = {
        **_common(data),
        "arm": data["arm"] is not None,
        "reason": data["reason"],
        "grid": number(data["arm"]["grid"]) if data["arm"] else "",
        "guided": bool(data["arm"]) and any(each["reference_of"] for each in data["arm"]["runs"].values()),
        "cases": {case: case_name(case) for case in data["cases"]},
        "choice": choice,
        "full": full,
        "runs": list(runs.values()) if len(runs) > 1 else [],
        "joints": [{"name": name, **look} for name, look in zip(data["joints"], data["joint_looks"], strict=True)],
        "plots": _plots(data, first=True),
    }
    return Section("motion", heading, "reports/templates/viewer.html", content)


def more_curves_section(data: Mapping[str, Any]) -> Section:
    """The curves that do not stand beside the arm."""
    plots = _plots(data, first=False)
    content = {**_common(data), "plots": plots} if plots else None
    return Section("curves", "More curves", "reports/templates/curves.html", content, folded=True)


def _common(data: Mapping[str, Any]) -> dict[str, Any]:
    first = next(iter(data["cases"].values()))
    decimated = max(case["samples"] for case in data["cases"].values()) > first["points"]
    return {"points": first["points"], "samples": first["samples"], "decimated": decimated}


def _plots(data: Mapping[str, Any], first: bool) -> list[dict[str, Any]]:
    """The plots of all cases by their id."""
    found = {plot["id"]: plot for case in data["cases"].values() for plot in case["plots"] if plot["first"] == first}
    return list(found.values())


def _largest(recording: Recording) -> list[float]:
    """Effort limit of each joint, or its largest effort if it has no limit that is known, shape (joints,)."""
    found: Array = abs(recording.effort).max(axis=0)
    limits: Mapping[str, float] = {}
    if recording.robot:
        with suppress(ParameterError):  # The description may be gone.
            robot = find_robot(recording.robot)
            limits = dict(zip(robot.joints, robot.effort_limit, strict=True))
    pairs = zip(recording.joints, found.tolist(), strict=True)
    largest = [limits[joint] if math.isfinite(limits.get(joint, math.inf)) else most for joint, most in pairs]
    return [each or 1.0 for each in largest]
