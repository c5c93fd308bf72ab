"""Figures of theory along a run: phase portraits, s with sigma and V, and the adaptive gain over its bound."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Recording
from pidtsm_studies.reports.figures import COLOURS, envelope, finished, line, logarithmic, panels, save_figures
from pidtsm_studies.theory.bounds import Bounds
from pidtsm_studies.theory.parts import Parts

_POINTS = 400
"""Points of the curve s = 0."""


def write_theory_figures(recording: Recording, bounds: Bounds, directory: Path) -> list[Path]:
    """Write phase.png, sliding.png and gain.png, and the same as SVG.

    Args:
        recording: of the run.
        bounds: along it.
        directory: output folder; created if missing.

    Returns:
        The files.
    """
    drawings: dict[str, Callable[[], Figure]] = {
        "phase": partial(phase, recording, bounds),
        "sliding": partial(sliding, recording, bounds),
        "gain": partial(gain, recording, bounds),
    }
    return save_figures(drawings, directory)


def phase(recording: Recording, bounds: Bounds) -> Figure:
    """Phase portraits: e' over e of each joint, with the curve s = 0 where the surface has one in this plane."""
    joints = len(recording.joints)
    figure = Figure(figsize=(7.0, 2.6 * ((joints + 1) // 2)), layout="constrained")
    table = np.atleast_1d(figure.subplots((joints + 1) // 2, min(joints, 2))).ravel()
    velocity = recording.velocity - recording.reference[:, 1]
    for j, ax in enumerate(table[:joints]):
        e, de = recording.error[:, j], velocity[:, j]
        ax.plot(e, de, color=COLOURS[0], label=str(recording.law))
        ax.plot(e[:1], de[:1], "o", color=COLOURS[0], markersize=4)
        _surface(ax, e, bounds.parts, j)
        unit = recording.units[j].position
        ax.set(xlabel=f"$e$ of {recording.joints[j]} ({unit})", ylabel=f"$\\dot e$ ({unit}/s)")
        ax.margins(0.05)
    table[0].legend()
    for ax in table[joints:]:
        ax.set_visible(False)
    return figure


def _surface(ax: Axes, e: Array, parts: Parts, j: int) -> None:
    """Draw s = 0 over the range of a joint's error, shape (samples,)."""
    drawn = surface_velocity(np.linspace(e.min(), e.max(), _POINTS), parts, j)
    if drawn is not None:
        grid, velocity = drawn
        ax.plot(grid, velocity, color=COLOURS[1], linestyle="--", label="$s = 0$")


def surface_velocity(error: Array, parts: Parts, j: int) -> tuple[Array, Array] | None:
    """The curve s = 0 in the plane of e and e'.

    Args:
        error: e, rad, shape (n,).
        parts: the law.
        j: index of the joint.

    Returns:
        e (rad) and e' (rad/s), shape (n,) each; None for a surface with the integral of e, which has none.
    """
    gains = {name: float(each[j]) for name, each in parts.gains.items()}
    size, sign = np.abs(error), np.sign(error)
    match parts.surface:
        case "dual_terminal":
            pull = gains["k1"] * (size ** gains["alpha"] + size**3) + gains["k2"] * size
        case "fast_terminal":
            pull = gains["k1"] * size ** gains["alpha"] + gains["k2"] * size
        case "terminal":
            pull = gains["k1"] * size ** gains["alpha"]
        case "linear":
            pull = gains["k1"] * size
        case "fast_nonsingular":
            pull = ((size + gains["k1"] * size ** gains["lambda"]) / gains["k2"]) ** (1.0 / gains["p_over_q"])
        case "nonsingular_terminal":
            pull = (size / gains["k2"]) ** (1.0 / gains["p_over_q"])
        case _:
            return None
    return error, -sign * pull


def sliding(recording: Recording, bounds: Bounds) -> Figure:
    """|s| and |sigma| of each joint with the band that counts as reached, and V, eq. (35), of all joints."""
    joints = len(recording.joints)
    figure, table = panels(joints + 1)
    for j, ax in enumerate(table[:joints, 0]):
        for style, (values, name) in enumerate(
            ((recording.sliding_variable, "$|s|$"), (recording.manifold_variable, r"$|\sigma|$"))
        ):
            line(ax, *envelope(recording.time, np.abs(values[:, j])), style, name)
        ax.axhline(bounds.band[j], color="0.35", linewidth=0.8, linestyle=":", label="reached")
        logarithmic(ax)
        ax.set_ylabel(f"{recording.joints[j]}\nenvelope (SI unit)")
    last = table[joints, 0]
    line(last, recording.time, bounds.lyapunov, 0, "$V$")
    logarithmic(last)
    last.set_ylabel("$V$")
    return finished(figure, table, recording)


def gain(recording: Recording, bounds: Bounds) -> Figure:
    """The switching gain of each joint over what the disturbance needs of it, and what (23) and (24) demand."""
    joints = len(recording.joints)
    figure, table = panels(joints)
    for j, ax in enumerate(table[:, 0]):
        need = np.nan_to_num(bounds.need[:, j])
        line(ax, recording.time, bounds.gain[:, j], 0, "switching gain")
        line(ax, *envelope(recording.time, need), 1, "needed", zorder=1.9)
        if np.isfinite(bounds.gain_condition[j]):
            ax.axhline(bounds.gain_condition[j], color=COLOURS[4], linewidth=0.8, linestyle="-.", label="(23), (24)")
        logarithmic(ax)
        ax.set_ylabel(f"{recording.joints[j]}\ngain (SI unit)")
    return finished(figure, table, recording)
