"""Data for the animated arm of the reports, drawn by arm.js."""

import base64
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.recording import Recording
from pidtsm_studies.article.claims import Run
from pidtsm_studies.reports.labels import Entry
from pidtsm_studies.reports.plots import colour
from pidtsm_studies.reports.skeleton import Skeleton, find_skeleton

_RATE = 50.0  # samples a second
_OBLIQUE = -math.pi / 3.0, math.pi / 9.0  # azimuth and elevation
_FLAT = 1e-3
"""Points lie in a plane if their spread across it is less than this share of their largest spread."""


def animation(cases: Mapping[str, Mapping[str, Run]], entries: Mapping[str, Entry]) -> dict[str, Any]:
    """The arm and its reference in each run, at the rate of the animation.

    Args:
        cases: runs by case and law or name, at least one.
        entries: legend, by law or name.

    Returns:
        Plain data for JSON. All points are in the frame of the base, m.

        * rate: samples a second.
        * centre, radius: of a sphere that contains everything.
        * grid: distance between the lines on the ground, m.
        * view: azimuth and elevation of the first view, rad; on the plane of a planar arm, else oblique.
        * runs: under ``CASE LAW``: colour; names and units of the joints; parents and sliding of the points, see
          `Skeleton`; event, s from the start, or None; and packed, all numbers of a sample together, points of the arm
          (reached) and of its reference, error (rad or m), and distance of the tool from its reference (m).

    Raises:
        ParameterError: where the joints of an arm are is not known; the message is one line.
    """
    scenes = {f"{case} {law}": (law, _scene(run[0])) for case, by_law in cases.items() for law, run in by_law.items()}
    points = np.concatenate([np.zeros((1, 3)), *(scene.every_point for _, scene in scenes.values())])
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    radius = max(float(np.linalg.norm(points - centre, axis=1).max()), 1e-3)
    return {
        "rate": _RATE,
        "centre": centre.round(4).tolist(),
        "radius": round(radius, 4),
        "grid": _rounded_down(0.5 * radius),
        "view": _view(points),
        "runs": {key: {"colour": colour(entries[law].style), **scene.data()} for key, (law, scene) in scenes.items()},
    }


@dataclass(frozen=True)
class _Scene:
    """A run; points have the shape (times, points, 3), m."""

    recording: Recording
    skeleton: Skeleton
    reached: Array
    reference: Array

    @property
    def every_point(self) -> Array:
        """Shape (any, 3)."""
        return np.concatenate([self.reached, self.reference]).reshape(-1, 3)

    def data(self) -> dict[str, Any]:
        """A run in the result of `animation`, without its colour."""
        recording = self.recording
        return {
            "joints": list(recording.joints),
            "units": [units.position for units in recording.units],
            "parents": self.skeleton.parents,
            "sliding": self.skeleton.sliding,
            "event": None if recording.event_time is None else recording.event_time - float(recording.time[0]),
            "reached": _packed(self.reached),
            "reference": _packed(self.reference),
            "error": _packed(_resampled(recording, recording.error)),
            "distance": _packed(np.linalg.norm(self.reached[:, -1] - self.reference[:, -1], axis=1)),
        }


def _scene(recording: Recording) -> _Scene:
    skeleton = find_skeleton(recording.robot)
    if set(skeleton.joints) != set(recording.joints):
        raise ParameterError(f"the recorded joints are not those of {recording.robot['robot.description']}")
    places = [recording.joints.index(joint) for joint in skeleton.joints]
    reached, reference = (
        skeleton.points(_resampled(recording, positions)[:, places])
        for positions in (recording.position, recording.desired)
    )
    return _Scene(recording, skeleton, reached, reference)


def _packed(values: Array) -> dict[str, str]:
    """Packed floats in the format of plotly.js: little-endian, base64."""
    return {"dtype": "f4", "bdata": base64.b64encode(values.astype("<f4").tobytes()).decode()}


def _resampled(recording: Recording, values: Array) -> Array:
    """Values at the rate of the animation, shape (times, joints)."""
    time = recording.time - recording.time[0]
    moments = np.arange(int(time[-1] * _RATE + 1e-6) + 1) / _RATE
    return np.column_stack([np.interp(moments, time, column) for column in values.T])


def _rounded_down(length: float) -> float:
    """The next smaller 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(length))
    return float(f"{max(step for step in (1, 2, 5) if step * power <= length) * power:g}")


def _view(points: Array) -> tuple[float, float]:
    """Azimuth and elevation (rad) of the viewer: perpendicular to the plane of the points, if they have one.

    Args:
        points: m, shape (any, 3).
    """
    variances, axes = np.linalg.eigh(np.cov(points.T))
    across, along, most = np.sqrt(np.maximum(variances, 0.0))
    if across > _FLAT * most or along <= _FLAT * most:
        return _OBLIQUE
    x, y, z = axes[:, 0]
    if (z if abs(z) > 0.5 else x - y) < 0.0:  # From above, or with x or y to the right.
        x, y, z = -x, -y, -z
    upright = math.hypot(x, y)
    return (math.atan2(y, x) if upright > _FLAT else -0.5 * math.pi), math.atan2(z, upright)
