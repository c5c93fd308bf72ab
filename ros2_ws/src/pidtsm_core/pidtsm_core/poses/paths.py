"""Lines and arcs of the tool, as motions of the joints within all limits."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.poses.kinematics import Distance, ToolKinematics
from pidtsm_core.poses.pose import Pose
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_core.trajectories.motion import PiecewiseMotion
from pidtsm_core.trajectories.timing import Along, retime

_SPACING = 5e-3, 0.03
"""Largest distance of way points, m and rad."""
_EXACT = 1e-6
"""Largest distance of the tool from a way point, m and rad."""
_ROUNDS, _ROUND = 50, 0.02
"""Rounds of the inverse kinematics for a way point, and the time that each stands for, s."""
_OFF = 1e-3, 5e-3
"""Farthest that the tool may be from its path between way points, m and rad."""
_SAMPLES = 200
"""Number of times at which that is checked."""
_RAMP = 0.1
"""Time in which the tool reaches its largest acceleration, s."""
_COLLINEAR = 1e-6
"""Three points whose sine is smaller are on a line."""


class Speed(NamedTuple):
    """Limits of the tool along its path."""

    velocity: float = 0.25  # m/s
    acceleration: float = 1.0  # m/s^2
    angular_velocity: float = 1.0  # rad/s
    angular_acceleration: float = 4.0  # rad/s^2


def line(start: Pose, end: Pose) -> list[Pose]:
    """Poses on the straight line between two, both included; the orientation turns evenly about one axis."""
    way, turn = start.way_to(end)
    count = max(math.ceil(np.linalg.norm(way) / _SPACING[0]), math.ceil(np.linalg.norm(turn) / _SPACING[1]), 1)
    return [*(start.moved(k / count * way, k / count * turn) for k in range(count)), end]


def arc(start: Pose, via: Array, end: Pose) -> list[Pose]:
    """Poses on the arc of a circle from one through a point (shape (3,), m) to another; it turns as on a line.

    Raises:
        TrajectoryError: the three points are on a line.
    """
    a, b = via - start.position, end.position - start.position
    normal = np.cross(a, b)
    if np.linalg.norm(normal) <= _COLLINEAR * np.linalg.norm(a) * np.linalg.norm(b):
        raise TrajectoryError("start, via and end of the arc are on a line, so that they define no circle")
    # Centre of the circle through three points, relative to the start.
    centre = np.cross(np.dot(a, a) * b - np.dot(b, b) * a, normal) / (2.0 * np.dot(normal, normal))
    x = -centre
    y = np.cross(normal / np.linalg.norm(normal), x)
    angle = math.atan2(np.dot(b - centre, y), np.dot(b - centre, x)) % (2.0 * math.pi)
    _, turn = start.way_to(end)
    length = angle * np.linalg.norm(x)
    count = max(math.ceil(length / _SPACING[0]), math.ceil(np.linalg.norm(turn) / _SPACING[1]), 2)
    poses = [start]
    for k in range(1, count):
        at = k / count * angle
        place = centre + math.cos(at) * x + math.sin(at) * y
        poses.append(start.moved(place, k / count * turn))
    return [*poses, end]


def plan_path(
    kinematics: ToolKinematics, q: Array, poses: Sequence[Pose], limits: MotionLimits, speed: Speed | None = None
) -> PiecewiseMotion:
    """The fastest motion of the tool through poses from rest to rest, within the limits of joints and tool.

    Args:
        kinematics: of the tool, with these limits.
        q: positions of the joints at the begin, shape (joints,), rad or m.
        poses: at least two, in the base frame, a few mm apart; the first is where the tool is.
        limits: of the arm.
        speed: limits of the tool; None: the default ones.

    Raises:
        TrajectoryError: the arm cannot reach a pose, or it cannot stay on the path, see also `retime`.
    """
    speed = speed or Speed()
    if min(speed) <= 0.0 or not np.isfinite(speed).all():
        raise TrajectoryError(f"speed and acceleration of the tool must be positive numbers, not {tuple(speed)}")
    ways = [a.way_to(b) for a, b in pairwise(poses)]
    steps = np.array([[np.linalg.norm(way), np.linalg.norm(turn)] for way, turn in ways])
    passed = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    joints = _joints(kinematics, q, poses)
    accelerations = np.array([speed.acceleration, speed.angular_acceleration])
    tool = Along(passed, np.array([speed.velocity, speed.angular_velocity]), accelerations, accelerations / _RAMP)
    motion = retime(joints, limits, tool)
    _check_path(kinematics, motion, poses, passed)
    return PiecewiseMotion(motion.parameters[: len(limits.joints)])


def _joints(kinematics: ToolKinematics, q: Array, poses: Sequence[Pose]) -> Array:
    """Positions of the joints at each pose, shape (poses, joints).

    Raises:
        TrajectoryError: the arm cannot reach one.
    """
    kinematics.prefer(q)
    found = [q]
    for k, pose in enumerate(poses[1:], start=1):
        left = Distance(math.inf, math.inf, (), False)
        for _ in range(_ROUNDS):
            q, left = kinematics.toward(q, pose, _ROUND)
            if max(left.position, left.angle) < _EXACT:
                break
        else:
            why = f"{', '.join(left.at_limit)} at the limit" if left.at_limit else "out of reach, or near a singularity"
            at = f"({', '.join(f'{x:.4g}' for x in pose.position)}) m"
            raise TrajectoryError(
                f"the tool cannot follow its path beyond {100.0 * (k - 1) / (len(poses) - 1):.0f} %: {at} is "
                f"{1e3 * left.position:.3g} mm and {left.angle:.3g} rad away: {why}"
            )
        found.append(q)
    return np.array(found)


def _check_path(kinematics: ToolKinematics, motion: PiecewiseMotion, poses: Sequence[Pose], passed: Array) -> None:
    """Check that the tool stays on its path between way points.

    Raises:
        TrajectoryError: it does not.
    """
    joints = motion.parameters.shape[0] - 2
    state, along = np.zeros((3, joints + 2)), passed.sum(axis=1)
    for t in np.linspace(0.0, motion.end, _SAMPLES):
        motion.evaluate(float(t), state)
        place = float(state[0, joints:].sum())
        k = min(max(int(np.searchsorted(along, place, side="right")) - 1, 0), len(poses) - 2)
        share = (place - along[k]) / max(along[k + 1] - along[k], 1e-12)
        way, turn = poses[k].way_to(poses[k + 1])
        off, twisted = kinematics.pose(state[0, :joints]).way_to(poses[k].moved(share * way, share * turn))
        if np.linalg.norm(off) > _OFF[0] or (kinematics.full and np.linalg.norm(twisted) > _OFF[1]):
            raise TrajectoryError(
                f"the tool would leave its path by {1e3 * np.linalg.norm(off):.3g} mm and "
                f"{np.linalg.norm(twisted):.3g} rad, because the joints turn too far on it: near a singularity"
            )
