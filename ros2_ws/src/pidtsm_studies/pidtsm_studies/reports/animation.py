"""Data for the animated arm of the reports, drawn by report.js."""

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pidtsm_core.parameters import Array
from pidtsm_core.recording import Recording
from pidtsm_studies.article.claims import Run
from pidtsm_studies.reports.plots import colour

_RATE = 50.0  # samples a second


def animation(
    cases: Mapping[str, Mapping[str, Run]], styles: Mapping[str, int], links: Sequence[float]
) -> dict[str, Any] | None:
    """Reference and error of each run of a planar arm, at the rate of the animation.

    Args:
        cases: runs by case and law.
        styles: index of each law's style, as returned by `labels.style_indices`.
        links: lengths of the links, m.

    Returns:
        Plain data for JSON: links, rate (1/s), box (left, top, width and height of the drawing, m), and for each run,
        under ``CASE LAW``, its colour, joints and event (s from the start, or None), and reference and error (rad),
        each packed, all joints of a sample together. None if the number of joints of a run differs from the links.
    """
    runs = {(case, law): recording for case, by_law in cases.items() for law, (recording, _) in by_law.items()}
    if any(len(recording.joints) != len(links) for recording in runs.values()):
        return None
    ends = np.concatenate([np.zeros((1, 2)), *(_link_ends(recording, links) for recording in runs.values())])
    margin = 0.08 * sum(links)
    low, high = ends.min(axis=0) - margin, ends.max(axis=0) + margin
    width, height = high - low
    return {
        "links": list(links),
        "rate": _RATE,
        "box": [round(float(x), 3) for x in (low[0], -high[1], width, height)],
        "runs": {
            f"{case} {law}": {
                "colour": colour(styles[law]),
                "joints": list(recording.joints),
                "event": None if recording.event_time is None else recording.event_time - float(recording.time[0]),
                "reference": _packed(_resampled(recording, recording.reference[:, 0])),
                "error": _packed(_resampled(recording, recording.error)),
            }
            for (case, law), recording in runs.items()
        },
    }


def _packed(values: Array) -> dict[str, str]:
    """Packed floats in the format of plotly.js: little-endian, base64."""
    return {"dtype": "f4", "bdata": base64.b64encode(values.astype("<f4").tobytes()).decode()}


def _resampled(recording: Recording, values: Array) -> Array:
    """Values at the rate of the animation, shape (times, joints)."""
    time = recording.time - recording.time[0]
    moments = np.arange(int(time[-1] * _RATE + 1e-6) + 1) / _RATE
    return np.column_stack([np.interp(moments, time, column) for column in values.T])


def _link_ends(recording: Recording, links: Sequence[float]) -> Array:
    """Actual and desired positions of the link ends, m, shape (points, 2)."""
    angles = np.concatenate([recording.position, recording.reference[:, 0]]).cumsum(axis=1)
    x, y = ((function(angles) * np.asarray(links)).cumsum(axis=1).ravel() for function in (np.cos, np.sin))
    return np.column_stack([x, y])
