"""Draws the figures of docs/theory.md, from rollouts with true derivatives.

./pidtsm shell -c "python scripts/theory.py"
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_studies import check_gains
from pidtsm_studies.reports.figures import STYLE, envelope, finished, line, logarithmic, panels
from pidtsm_studies.theory.conditions import manifold_roots
from pidtsm_studies.theory.figures import gain, phase

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
EXACT: Mapping[str, Any] = {"estimator.name": "exact", "law.anti_windup": "none"}
IDEAL: Mapping[str, Any] = {**EXACT, "law.upsilon": 0.01}
"""The article's equations as they are written."""
SURFACE_ALONE: Mapping[str, Any] = {
    **EXACT,
    "law.surface": "dual_terminal",
    "law.manifold": "none",
    "law.reaching": "super_twisting",
    "law.gain": 30.0,
    "law.integral_gain": 50.0,
}
DURATION = 15.0  # s
_FROM = 2.0
"""Time from which on the slower root alone is left, s."""


def with_manifold() -> Recording:
    """Case 1 with PIDDTSM, without a disturbance."""
    return rollout("case1", duration=DURATION, controller=IDEAL, simulator={"disturbance.name": "none"})


def without_manifold() -> Recording:
    """The same with the surface alone, which is reached in a finite time."""
    quiet = {"disturbance.name": "none"}
    return rollout("case1", "sliding_mode", duration=DURATION, controller=SURFACE_ALONE, simulator=quiet)


def decay(ours: Recording, alone: Recording) -> Figure:
    """|s| and |e| of the first joint with the slopes that theory gives, and |e| without the manifold."""
    figure, table = panels(2)
    s, e = table[:, 0]
    slow = manifold_roots(2.0, 1.0, 0.5)[0].real
    time = np.array([_FROM, DURATION])
    start = int(np.searchsorted(ours.time, _FROM))
    for ax, values, rate in (
        (s, np.abs(ours.sliding_variable[:, 0]), slow),
        (e, np.abs(ours.error[:, 0]), slow * 9.0 / 7.0),
    ):
        line(ax, *envelope(ours.time, values), 0, "piddtsm")
        slope = 2.0 * values[start] * np.exp(rate * (time - _FROM))
        line(ax, time, slope, 1, f"slope {rate:.3f} 1/s")
    line(e, *envelope(alone.time, np.maximum(np.abs(alone.error[:, 0]), 1e-12)), 3, "without the manifold")
    for ax, label in ((s, "$|s|$ (rad/s)"), (e, "$|e|$ (rad)")):
        logarithmic(ax)
        ax.set_ylabel(f"joint1\n{label}")
    s.set_ylim(1e-6, 10.0)
    e.set_ylim(1e-9, 1.0)
    return finished(figure, table, ours, "Case 1 without a disturbance", groups=2)


def main() -> None:
    """Write the figures."""
    check = check_gains("case2", controller=IDEAL)
    assert check.bounds is not None
    assert check.recording is not None
    with matplotlib.rc_context(STYLE):
        for name, figure in (
            ("decay", decay(with_manifold(), without_manifold())),
            ("gain", gain(check.recording, check.bounds)),
            ("phase", phase(check.recording, check.bounds)),
        ):
            figure.savefig(IMAGES / f"theory-{name}.png", metadata={"Software": None})


if __name__ == "__main__":
    main()
