"""The page about what was understood of an arm."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pidtsm_core.parameters import ParameterError
from pidtsm_core.robots.check import ArmCheck, Doubt
from pidtsm_core.written import number, quantity, readable
from pidtsm_studies.checks.drawing import drawing
from pidtsm_studies.checks.tables import (
    JOINTS,
    LINKS,
    LOADS,
    LOCKED,
    facts,
    joint_rows,
    link_rows,
    load_rows,
    locked_rows,
)
from pidtsm_studies.reports.page import BAD, GOOD, PLAIN, Answer, Page, Section, write_page


def write_check_report(path: Path, check: ArmCheck, settings: Mapping[str, object]) -> None:
    """Write the page; the same result gives the same file.

    Args:
        path: the HTML file; an existing one is replaced.
        check: the result.
        settings: parameters of the robot, with which it was checked.
    """
    fixed = [[joint.name, f"{joint.parent} to {joint.child}", joint.reason] for joint in check.fixed]
    tables = [
        _table("Joints: axis in the frame of the joint, limits (rad and rad/s; m and m/s)", JOINTS, joint_rows(check)),
        _table(
            "Motors: effort limit and gravity's largest torque (N m or N), least inertia that the motor accelerates "
            "while the other joints move freely, rotor, and friction",
            LOADS,
            load_rows(check),
        ),
        _table(
            "Links: what moves with each joint, centre of mass from the joint with z along its axis, and inertias "
            "about it (kg m²)",
            LINKS,
            link_rows(check),
        ),
        _table("Joints that do not move", LOCKED, locked_rows(check)),
        _table("Fixed joints", ("joint", "links", "reason"), fixed),
    ]
    sections = (
        _section("doubts", "Doubts", _doubts(check)),
        _section("picture", "The arm", _picture(check, settings)),
        _section("facts", "What was understood", facts(check)),
        _section("tables", "Joints and links", [table for table in tables if table["rows"]], folded=True),
    )
    state = BAD if check.refusal is not None else PLAIN if check.doubts else GOOD
    title = f"Check of {Path(check.source).name}"
    write_page(path, Page(title, summary(check), state, check.source, _answers(check), sections))


def summary(check: ArmCheck) -> str:
    """What the check found, in one sentence."""
    if check.refusal is not None:
        return "This arm cannot be used."
    joints = f"{len(check.used)} joint{'s' if len(check.used) != 1 else ''}"
    if not check.doubts:
        return f"This arm with {joints} can be used; nothing looks like a mistake."
    number = len(check.doubts)
    looks = f"{number} thing{'s look like mistakes' if number > 1 else ' looks like a mistake'}"
    return f"This arm with {joints} can be used, but {looks}."


def _answers(check: ArmCheck) -> list[Answer]:
    """What a user wants to know of an arm first; nothing if it cannot be used."""
    if check.refusal is not None:
        return []
    reach = f"reach {quantity(check.reach, 'm')}" if math.isfinite(check.reach) else ""
    mass = f"{number(sum(mass.mass for mass in check.masses))} kg move" if check.masses else ""
    count = len(check.doubts)
    answers = [
        Answer("Can it be used?", "Yes", f"{len(check.used)} joints", GOOD),
        Answer(
            "What looks wrong?",
            f"{count} doubt{'s' if count != 1 else ''}" if count else "Nothing",
            str(check.doubts[0]) if count else "",
            BAD if count else PLAIN,
        ),
        Answer("How large is it?", reach or "not known", mass),
    ]
    loaded = [
        (load.gravity / joint.effort, joint.name)
        for joint, load in zip(check.used, check.loads, strict=False)
        if math.isfinite(joint.effort) and joint.effort > 0.0
    ]
    if loaded:
        share, name = max(loaded)
        answers.append(
            Answer("Which joint carries most?", name, f"gravity takes {number(100.0 * share, 2)} % of its effort")
        )
    return answers


def _section(name: str, heading: str, content: Any, folded: bool = False) -> Section:
    return Section(name, heading, f"checks/templates/{name}.html", content, folded)


def _table(caption: str, columns: Sequence[str], rows: list[list[str]]) -> dict[str, Any]:
    shown = [[name, *map(readable, cells)] for name, *cells in rows]
    return {"caption": caption, "columns": columns, "rows": shown}


def _doubts(check: ArmCheck) -> list[dict[str, str]]:
    refusal = [] if check.refusal is None else [("cannot be used", check.refusal)]
    every = [*refusal, *(("doubt", each) for each in check.doubts), *(("note", each) for each in check.notes)]
    return [{"kind": kind, "where": _where(check, each), "text": str(each)} for kind, each in every]


def _where(check: ArmCheck, doubt: Doubt) -> str:
    return check.where(doubt) if doubt.name else ""


def _picture(check: ArmCheck, settings: Mapping[str, object]) -> dict[str, Any]:
    if check.refusal is not None:
        return {}
    try:
        return drawing(settings)
    except ParameterError:
        return {}
