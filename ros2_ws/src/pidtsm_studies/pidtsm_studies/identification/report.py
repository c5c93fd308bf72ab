"""The page of an identification: torques on data kept apart, parameters with intervals, and what is not known."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.identification.identification import Identification
from pidtsm_core.units import JointUnits, either, joint_units
from pidtsm_core.written import DIGITS, THIN, number, quantity, scale
from pidtsm_studies.identification.results import as_json
from pidtsm_studies.reports.animation import motion, resampled
from pidtsm_studies.reports.curves import Quantity, curves
from pidtsm_studies.reports.labels import Entry
from pidtsm_studies.reports.matrix import difference, worst
from pidtsm_studies.reports.packed import packed
from pidtsm_studies.reports.page import BAD, GOOD, PLAIN, Answer, Page, Section, write_page
from pidtsm_studies.reports.viewer import assembled, run_data, viewer_section

_CASE = "apart"
_APART = (
    "The last fifth of each recording was not fitted. Where a joint hardly moves, its friction is not predictable, and "
    "the errors do not count these samples."
)
_RIGHT = 0.001
"""A description whose torque errors are less than this share of each joint's largest torque needs no correction."""
_QUANTITIES = (
    Quantity("residual", "Measured minus predicted torque", "Δτ", "effort", lambda each: each.residual, first=True),
    Quantity("torque", "Torque, on data kept apart", "τ", "effort", lambda each: each.torque, first=True),
)


@dataclass(frozen=True)
class Predicted:
    """Torques on the data kept apart.

    Attributes:
        time: s, shape (samples,).
        joints: names.
        units: of each joint.
        torque: N m or N, shape (samples, joints).
        residual: measured minus this torque, likewise.
    """

    time: Array
    joints: tuple[str, ...]
    units: tuple[JointUnits, ...]
    torque: Array
    residual: Array


def write_identification_report(path: Path, found: Identification, robot: str, source: str = "") -> None:
    """Write the page; the same result gives the same file.

    Args:
        path: the HTML file; an existing one is replaced.
        found: the result.
        robot: name of the arm, for the title.
        source: of the description, where the meshes of the arm are looked for.
    """
    result = as_json(found)
    errors = result["torque_error"]
    joint = worst(errors["after"], found.units) or 0
    data = _viewer(found, joint, source)
    sections = (
        viewer_section(data, "Torque", "Motion and torque", "the largest one"),
        Section(
            "errors",
            "Torque error",
            "reports/templates/matrix.html",
            {"tables": [_errors(found, result)], "failures": [], "note": _APART},
        ),
        _section("warnings", "Warnings", result["warnings"], folded=True),
        Section("links", "Joints and links", "identification/templates/joints.html", _joints(result), folded=True),
        _section("combinations", "Combinations of parameters", _combinations(result), folded=True),
        _section("unknown", "What data cannot show", result, folded=True),
    )
    before, after = errors["before"][joint], errors["after"][joint]
    better = after < before
    name, unit = result["joints"][joint], found.units[joint]
    change = difference(before, after, scale([before], unit))
    right = _is_right(found, errors["before"])
    if right:
        most = worst(errors["before"], found.units) or 0
        within = f"{quantity(errors['before'][most], found.units[most])} RMS ({result['joints'][most]})"
        verdict = f"The description is right: it predicts the torque of every joint within {within}."
    else:
        verdict = (
            f"The identified model predicts the torque of every joint within {quantity(after, unit)} RMS ({name}), "
            f"{change} against the description."
        )
    page = Page(
        f"Identification of {robot}",
        verdict,
        GOOD if better or right else PLAIN,
        _summary(found, result),
        _answers(found, result, joint),
        sections,
        data,
    )
    write_page(path, page)


def _section(name: str, heading: str, content: Any, folded: bool = False) -> Section:
    return Section(name, heading, f"identification/templates/{name}.html", content, folded)


def _is_right(found: Identification, errors: Sequence[float]) -> bool:
    """Whether there is nothing to correct: RMS errors of the description, one per joint, against the largest torque."""
    return bool(np.all(np.asarray(errors) <= _RIGHT * np.abs(found.check.measured).max(axis=0)))


def _summary(found: Identification, result: dict[str, Any]) -> str:
    delay = result["delay"]
    return (
        f"Bandwidth {number(found.cutoff)} Hz, condition number {number(found.fit.condition)}, torque "
        f"{number(1e3 * abs(delay['value']))} ± {number(1.96e3 * delay['deviation'], 2)} ms "
        f"{'after' if delay['value'] >= 0.0 else 'before'} the motion by its stamps"
    )


def _answers(found: Identification, result: dict[str, Any], joint: int) -> list[Answer]:
    errors, warnings = result["torque_error"], result["warnings"]
    better = sum(after < before for before, after in zip(errors["before"], errors["after"], strict=True))
    count = len(result["joints"])
    known = sum(each["determined"] for each in result["combinations"])
    right = _is_right(found, errors["before"])
    return [
        Answer(
            "Is the description right?" if right else "Is the new model better?",
            "Yes" if right else f"For {better} of {count} joints",
            "on data that were not fitted",
            GOOD if right or better == count else BAD,
        ),
        Answer(
            "What was found?",
            f"{known} of {len(result['combinations'])} combinations",
            "of parameters, known better from the data than from the description",
        ),
        Answer(
            "What to look at?",
            f"{len(warnings)} warning{'s' if len(warnings) != 1 else ''}" if warnings else "Nothing",
            warnings[0] + (f"; and {len(warnings) - 1} more below" if warnings[1:] else "") if warnings else "",
            BAD if warnings else PLAIN,
        ),
        Answer(
            "Which joint is worst?",
            result["joints"][joint],
            f"RMS {quantity(errors['after'][joint], found.units[joint])}",
        ),
    ]


def _viewer(found: Identification, joint: int, source: str) -> dict[str, Any]:
    check, joints = found.check, tuple(found.arm.joints)
    units = joint_units([bool(slides) for slides in found.arm.slides], len(joints))
    torques = {"measured": check.measured, "description": check.before, "identified": check.after}
    every = {
        key: Predicted(check.time - check.time[0], joints, units, torque, check.measured - torque)
        for key, torque in torques.items()
    }
    styles = {"measured": 2, "description": 1, "identified": 0}
    runs = {
        f"{_CASE} {key}": {
            **run_data(_CASE, key, each.time, Entry(key, styles[key])),
            "largest": np.abs(check.measured).max(axis=0).tolist(),
            "events": [],
            "error": packed(resampled(each.time, each.residual)),
            "effort": packed(resampled(each.time, each.torque)),
        }
        for key, each in every.items()
    }
    drawn = {_CASE: curves(every, _QUANTITIES)}
    shown = [[unit.effort, unit.effort] for unit in units]
    heads = {"heads": ["measured minus predicted", "torque"]}
    arm = motion(f"{_CASE} measured", found.arm, source, check.time - check.time[0], check.motion.position)
    return assembled(joints, shown, drawn, runs, joint) | heads | {"arm": arm}


def _errors(found: Identification, result: dict[str, Any]) -> dict[str, Any]:
    """A matrix: a row for the torque of each origin, a column for each joint."""
    errors = result["torque_error"]
    rows = {
        "description": errors["before"],
        "identified": errors["after"],
        "the files, read back": errors["as_written"],
        "identified, on the data that were fitted": errors["of_training"],
    }
    known = {name: values for name, values in rows.items() if values is not None}
    shown = {
        unit: scale(
            [v for values in known.values() for v, its in zip(values, found.units, strict=True) if its == unit], unit
        )
        for unit in dict.fromkeys(found.units)
    }
    unit = either(each.unit for each in shown.values())
    return {
        "caption": f"Root mean square error of the torque, {unit}",
        "corner": "torque of",
        "joints": [{"name": joint, "note": ""} for joint in result["joints"]],
        "rows": [
            {
                "head": name,
                "about": "",
                "unit": "",
                "cells": [
                    {
                        "text": number(shown[its].factor * value),
                        "value": repr(value),
                        "title": f"{value!r} {its}",
                        "worst": j == worst(values, found.units),
                        "key": name,
                        "joint": j,
                        "difference": ""
                        if name == "description"
                        else difference(errors["before"][j], value, shown[its]),
                    }
                    for j, (value, its) in enumerate(zip(values, found.units, strict=True))
                ],
            }
            for name, values in known.items()
        ],
    }


def _joints(result: dict[str, Any]) -> list[list[str]]:
    rows = []
    for j, (joint, link) in enumerate(zip(result["joints"], result["links"], strict=True)):
        before, after = link["described"], link["identified"]
        rows.append(
            [
                joint,
                *(number(result[name][j]) for name in ("coulomb", "viscous", "armature", "offset")),
                f"{number(before['mass'])} → {number(after['mass'])}",
                f"{_place(before['center_of_mass'])} → {_place(after['center_of_mass'])}",
            ]
        )
    return rows


def _place(center: Sequence[float]) -> str:
    return " ".join(number(round(1e3 * value)) for value in center)


def _combinations(result: dict[str, Any]) -> list[list[str]]:
    return [
        [
            each["combination"],
            number(each["described"]),
            f"{number(each['value'], DIGITS)}{THIN}±{THIN}{number(each['interval'], 2)}"
            if each["determined"]
            else "not determined by the data",
        ]
        for each in result["combinations"]
    ]
