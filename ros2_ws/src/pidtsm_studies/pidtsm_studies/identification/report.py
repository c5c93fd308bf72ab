"""The page of an identification: torques on data kept apart, parameters with intervals, and what is not known."""

from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from pidtsm_core.arrays import Array
from pidtsm_core.identification.identification import Check, Identification
from pidtsm_studies.identification.results import as_json
from pidtsm_studies.reports.page import Section, write_page
from pidtsm_studies.reports.plots import colour, set_style

_STYLES = {"measured": "#8a8a8a", "description": colour(1), "identified": colour(0)}


def write_identification_report(path: Path, found: Identification, robot: str) -> None:
    """Write the page; the same result gives the same file.

    Args:
        path: the HTML file; an existing one is replaced.
        found: the result.
        robot: name of the arm, for the title.
    """
    result = as_json(found)
    joints = result["joints"]
    figures = {"torque": _torques(found.check, joints), "residual": _residuals(found.check, joints)}
    plots = [
        {"id": "torque", "title": "Torque, on data kept apart", "height": figures["torque"].layout.height},
        {"id": "residual", "title": "Measured minus predicted torque", "height": figures["residual"].layout.height},
    ]
    sections = (
        _section("warnings", "Warnings", result["warnings"]),
        _section("errors", "Torque", {"rows": _errors(result), "plots": plots}),
        _section("joints", "Joints and links", _joints(result)),
        _section("combinations", "Combinations of parameters", _combinations(result)),
        _section("unknown", "What data cannot show", result),
    )
    delay = result["delay"]
    summary = (
        f"bandwidth {found.cutoff:.3g} Hz, condition number {found.fit.condition:.3g}, torque "
        f"{1e3 * abs(delay['value']):.2f} ± {1.96e3 * delay['deviation']:.2f} ms "
        f"{'after' if delay['value'] >= 0.0 else 'before'} the motion by its stamps"
    )
    write_page(path, f"Identification of {robot}", summary, sections, figures)


def _section(name: str, heading: str, content: Any) -> Section:
    return Section(name, heading, f"identification/templates/{name}.html", content)


def _errors(result: dict[str, Any]) -> list[list[str]]:
    errors = result["torque_error"]
    written = errors["as_written"] or [None] * len(result["joints"])
    return [
        [joint, *("" if value is None else f"{value:.3g}" for value in values)]
        for joint, *values in zip(
            result["joints"], errors["before"], errors["after"], written, errors["of_training"], strict=True
        )
    ]


def _joints(result: dict[str, Any]) -> list[list[str]]:
    rows = []
    for j, (joint, link) in enumerate(zip(result["joints"], result["links"], strict=True)):
        before, after = link["described"], link["identified"]
        rows.append(
            [
                joint,
                *(f"{result[name][j]:.3g}" for name in ("coulomb", "viscous", "armature", "offset")),
                f"{before['mass']:.3g} → {after['mass']:.3g}",
                f"{_place(before)} → {_place(after)}",
            ]
        )
    return rows


def _place(link: dict[str, Any]) -> str:
    return " ".join(f"{1e3 * value:.0f}" for value in link["center_of_mass"])


def _combinations(result: dict[str, Any]) -> list[list[str]]:
    return [
        [
            each["combination"],
            f"{each['described']:.3g}",
            f"{each['value']:.3g} ± {each['interval']:.2g}" if each["determined"] else "not determined by the data",
        ]
        for each in result["combinations"]
    ]


def _torques(check: Check, joints: list[str]) -> Any:
    """Torque measured, and predicted before and after, over time."""
    lines = {"measured": check.measured, "description": check.before, "identified": check.after}
    return _figure(check.time, joints, lines, "τ (N m)")


def _residuals(check: Check, joints: list[str]) -> Any:
    lines = {"description": check.measured - check.before, "identified": check.measured - check.after}
    return _figure(check.time, joints, lines, "Δτ (N m)")


def _figure(time: Array, joints: list[str], lines: dict[str, Array], axis: str) -> Any:
    """One panel per joint; lines have shape (samples, joints)."""
    figure = make_subplots(rows=len(joints), cols=1, shared_xaxes=True, vertical_spacing=0.02)
    for name, values in lines.items():
        for j in range(len(joints)):
            figure.add_trace(
                go.Scatter(
                    x=(time - time[0]).astype(np.float32),
                    y=values[:, j].astype(np.float32),
                    mode="lines",
                    name=name,
                    legendgroup=name,
                    showlegend=j == 0,
                    line={"color": _STYLES[name], "width": 1.6},
                ),
                j + 1,
                1,
            )
    set_style(figure, 120 + 170 * len(joints))
    figure.update_xaxes(title_text="time (s)", row=len(joints), col=1)
    for j, joint in enumerate(joints):
        figure.update_yaxes(title_text=f"{escape(joint)}<br>{axis}", row=j + 1, col=1)
    return figure
