"""What a commissioning leaves: parameters of the controller with their reasons, and the corrected description."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.robots import DESCRIPTION
from pidtsm_studies.commissioning.model import ArmModel
from pidtsm_studies.commissioning.session import Session

PARAMETERS, URDF, MJCF, REPORT = "commission.yaml", "commissioned.urdf", "commissioned.xml", "report.html"
"""Names in the folder of a session."""
_WIDTH = 100


def write_result(session: Session) -> list[str]:
    """Write what is complete so far into the folder of a session; returns the names of the files.

    With the new parameters if they were better, else with those before.
    """
    written = []
    identified = session.found.get("identify", {}).get("figures", {}).get("parameters", {})
    description = ""
    if identified:
        text = identified[DESCRIPTION.name]
        description = URDF if "<robot" in text else MJCF
        _write(session.folder / description, text)
        written.append(description)
    if "compare" in session.found:
        _write(session.folder / PARAMETERS, parameter_file(session, description))
        written.append(PARAMETERS)
    return written


def _write(path: Path, text: str) -> None:
    unfinished = path.with_name(f".{path.name}")
    unfinished.write_text(text, encoding="utf-8")
    unfinished.replace(path)


def chosen(session: Session, description: str) -> dict[str, tuple[Any, str]]:
    """Parameters that are to be used, by name, with the reason for each.

    Args:
        session: a complete one.
        description: name of the corrected description in the folder; empty: there is none.
    """
    compared = session.found["compare"]
    if not compared["figures"]["better"]:
        before = session.subject.before
        return {name: (value, "as before, because the new ones were not better") for name, value in before.items()}
    result: dict[str, tuple[Any, str]] = {}
    for name, value in session.subject.arm.items():
        result[name] = (value, "the arm, as given")
    if description:
        identified = session.found["identify"]["figures"]["parameters"]
        for name, value in identified.items():
            if not name.startswith("compensation."):
                result[name] = (value, "of the identified arm")
        sure = session.found["identify"]["figures"]["bodies"]
        result[DESCRIPTION.name] = (str((session.folder / description).absolute()), f"the identified bodies: {sure}")
    for step in ("identify", "gains"):
        for name, (value, reason) in session.found[step]["parameters"].items():
            result[name] = (value, reason)
    if not description:
        swung = session.found.get("springs", {}).get("parameters", {})
        result |= _friction(session) | {name: (value, reason) for name, (value, reason) in swung.items()}
    return result


def _friction(session: Session) -> dict[str, tuple[Any, str]]:
    figures = session.found["friction"]["figures"]
    half = _listed(figures["half_interval"])
    return {"compensation.coulomb": (figures["coulomb"], f"of the sweeps, ± {half} (95 %)")}


def _listed(values: Sequence[float] | Array) -> str:
    return ", ".join(f"{each:.2g}" for each in values)


def _measured(session: Session) -> list[str]:
    """What the gains follow from, with intervals of 95 %, as sentences; of the steps that are done."""
    said = []
    if rest := _figures(session.found, "rest"):
        noise, half = (1e3 * np.array(rest[name]) for name in ("noise", "noise_half_interval"))
        said.append(f"noise of the positions: {_listed(noise)} mrad or mm, ± {_listed(half)}")
    if "lateness" in session.found:
        step = "springs" if "delay" in _figures(session.found, "springs") else "lateness"
        said.append(session.found[step]["verdict"])
    if friction := _figures(session.found, "friction"):
        said.append(
            f"Coulomb friction of the sweeps: {_listed(friction['coulomb'])} N m or N, "
            f"± {_listed(friction['half_interval'])}"
        )
    if gravity := _figures(session.found, "gravity"):
        share, deviation = (100.0 * np.array(gravity[name]) for name in ("share", "share_deviation"))
        said.append(f"gravity beyond the description: {_listed(share)} %, ± {_listed(2.0 * deviation)}")
    springs = _figures(session.found, "springs")
    if "stiffness" in springs:
        half = 100.0 * np.array(springs["uncertainty"][1])
        said.append(f"stiffness of the gears: {_listed(springs['stiffness'])} N m/rad (0: rigid), ± {_listed(half)} %")
    return said


def parameter_file(session: Session, description: str) -> str:
    """ROS parameter file for the nodes, with the reason above each parameter."""
    compared = session.found["compare"]
    head = [
        f"# Made by ./pidtsm commission. {_sentence(compared['verdict'])}",
        *(f"# {_sentence(each)}" for each in _measured(session)),
        *(f"# Look: {_sentence(each)}" for step in session.found.values() for each in step["problems"]),
    ]
    lines = [*(fill(each, _WIDTH, subsequent_indent="# ") for each in head), "controller:", "  ros__parameters:"]
    for name, (value, reason) in chosen(session, description).items():
        lines.append(fill(reason, _WIDTH, initial_indent="    # ", subsequent_indent="    # "))
        lines.append(f"    {name}: {json.dumps(value)}")
    return "\n".join(lines) + "\n"


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def differences(session: Session) -> list[tuple[str, str, float, float]]:
    """Figures of repeated steps: what, joint, before and now; for wear, temperature and loads."""
    found = []
    for step, name, text in (
        ("friction", "coulomb", "Coulomb friction"),
        ("friction", "breakaway", "torque to break away"),
        ("gravity", "share", "share of gravity that is missing"),
        ("rest", "noise", "noise of the position"),
    ):
        before, now = (_figures(each, step).get(name) for each in (session.previous, session.found))
        if before is not None and now is not None:
            joints = ArmModel(session.subject.arm).joints
            found += [(text, str(joint), a, b) for joint, a, b in zip(joints, before, now, strict=True)]
    return found


def _figures(steps: Mapping[str, Mapping[str, Any]], step: str) -> Mapping[str, Any]:
    figures: Mapping[str, Any] = steps.get(step, {}).get("figures", {})
    return figures
