"""Data for the animated arm of the reports, drawn by arm.js."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pidtsm_core.arrays import Array
from pidtsm_core.parameters import ParameterError
from pidtsm_core.recording import Recording
from pidtsm_core.robots import Description
from pidtsm_studies.article.claims import Run
from pidtsm_studies.reports.meshes import Solid, packed_solid, solids, solids_of
from pidtsm_studies.reports.packed import packed
from pidtsm_studies.reports.skeleton import Skeleton, find_skeleton, skeleton_of

RATE = 50.0
"""Samples of the animation a second."""
_OBLIQUE = -math.pi / 3.0, math.pi / 9.0  # azimuth and elevation
_SAME = 1e-6
"""References that differ less are drawn once, m."""
_FLAT = 1e-3
"""Points lie in a plane if their spread across it is less than this share of their largest spread."""


def animation(cases: Mapping[str, Mapping[str, Run]]) -> dict[str, Any]:
    """The arm and its reference in each run, at the rate of the animation.

    Args:
        cases: runs by case and law or name, at least one.

    Returns:
        Plain data for JSON. All points are in the frame of the base, m.

        * centre, radius: of a sphere that contains everything.
        * grid: distance between the lines on the ground, m.
        * view: azimuth and elevation of the first view, rad; on the plane of a planar arm, else oblique.
        * runs: under ``CASE LAW``: parents and sliding of the points, see `Skeleton`; places, the recorded joint of
          each point but the tool; reference_of, key of the run that has the same reference (empty without one); and
          packed, all numbers of a sample together, points of the arm (reached) and of its reference (empty if another
          run has it), turns of the frames of its joints (quaternions x, y, z, w, to the base; empty but for the first
          run), and distance of the tool from its reference (m).
        * meshes: of the first run, see `packed_solid`.

    Raises:
        ParameterError: where the joints of an arm are is not known; the message is one line.
    """
    scenes = {f"{case} {law}": _scene(run[0]) for case, by_law in cases.items() for law, run in by_law.items()}
    first = next(run for runs in cases.values() for run, _ in runs.values())
    return _drawn(scenes, solids(first.robot))


def motion(key: str, arm: Description, source: str, time: Array, position: Array) -> dict[str, Any]:
    """An arm that moves without a reference; see `animation`.

    Args:
        key: of the only run.
        arm: the arm.
        source: of its description, where its meshes are looked for.
        time: s, shape (samples,).
        position: rad or m, in the order of the arm's joints, shape (samples, joints).
    """
    skeleton = skeleton_of(arm)
    reached, rotations = skeleton.placed(resampled(time, position))
    scene = _Scene(skeleton, skeleton.places, reached, reached[:0], rotations)
    return _drawn({key: scene}, solids_of(arm, source))


def _drawn(scenes: "Mapping[str, _Scene]", found: Sequence[Solid]) -> dict[str, Any]:
    """The result of `animation`."""
    points = np.concatenate([np.zeros((1, 3)), *(scene.every_point for scene in scenes.values())])
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    radius = max(float(np.linalg.norm(points - centre, axis=1).max()), 1e-3)
    return {
        "centre": centre.round(4).tolist(),
        "radius": round(radius, 4),
        "grid": _rounded_down(0.5 * radius),
        "view": _view(points),
        "runs": _data(scenes),
        "meshes": [packed_solid(solid) for solid in found],
    }


def _data(scenes: "Mapping[str, _Scene]") -> dict[str, dict[str, Any]]:
    """Runs in the result of `animation`; what would be drawn twice, or not at all, is left out."""
    found: dict[str, dict[str, Any]] = {}
    drawn: list[tuple[str, _Scene]] = []
    for key, scene in scenes.items():
        found[key] = scene.data()
        same = next((name for name, other in drawn if _alike(scene.reference, other.reference)), None)
        found[key]["reference"] = packed(scene.reference) if same is None else ""
        found[key]["reference_of"] = (same or key) if len(scene.reference) else ""
        drawn += [(key, scene)] if same is None else []
        found[key]["turns"] = "" if len(found) > 1 else packed(scene.turns)
    return found


def _alike(reference: Array, other: Array) -> bool:
    return reference.shape == other.shape and bool(np.abs(reference - other).max() < _SAME)


def moments(recording: Recording) -> dict[str, Any]:
    """What is written beside the arm at the rate of the animation: packed error and effort, shape (times, joints)."""
    return {
        "error": packed(resampled(recording.time, recording.error)),
        "effort": packed(resampled(recording.time, recording.effort)),
    }


@dataclass(frozen=True)
class _Scene:
    """A run; points have the shape (times, points, 3), m; without a reference there are none of it."""

    skeleton: Skeleton
    places: list[int]
    reached: Array
    reference: Array
    rotations: Array

    @property
    def turns(self) -> Array:
        """Quaternions x, y, z, w from the frames of the joints to the base, shape (times, joints, 4)."""
        count, joints = self.rotations.shape[:2]
        return Rotation.from_matrix(self.rotations.reshape(-1, 3, 3)).as_quat().reshape(count, joints, 4)

    @property
    def every_point(self) -> Array:
        """Shape (any, 3)."""
        return np.concatenate([self.reached, self.reference]).reshape(-1, 3)

    def _distance(self) -> Array:
        """Distance of the tool from its reference, m, shape (times,); 0 without a reference."""
        reference = self.reference if len(self.reference) else self.reached
        return np.asarray(np.linalg.norm(self.reached[:, -1] - reference[:, -1], axis=1))

    def data(self) -> dict[str, Any]:
        """A run in the result of `animation`, without reference and turns."""
        return {
            "parents": self.skeleton.parents,
            "sliding": self.skeleton.sliding,
            "places": self.places,
            "reached": packed(self.reached),
            "distance": packed(self._distance()),
        }


def _scene(recording: Recording) -> _Scene:
    skeleton = find_skeleton(recording.robot)
    if set(skeleton.joints) != set(recording.joints):
        raise ParameterError(f"the recorded joints are not those of {recording.robot['robot.description']}")
    order = [recording.joints.index(joint) for joint in skeleton.joints]
    places = [order[place] for place in skeleton.places]
    (reached, rotations), (reference, _) = (
        skeleton.placed(resampled(recording.time, positions)[:, order])
        for positions in (recording.position, recording.desired)
    )
    return _Scene(skeleton, places, reached, reference, rotations)


def resampled(time: Array, values: Array) -> Array:
    """Values at the rate of the animation, shape (times, joints)."""
    since = time - time[0]
    times = np.arange(int(since[-1] * RATE + 1e-6) + 1) / RATE
    return np.column_stack([np.interp(times, since, column) for column in values.T])


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
