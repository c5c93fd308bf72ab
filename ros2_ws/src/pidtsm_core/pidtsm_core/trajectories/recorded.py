"""A recorded motion as targets of a stream: smoothed, at a regular rate."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from pidtsm_core.arrays import Array
from pidtsm_core.robots import inverse_dynamics
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import MotionLimits

RATE = 100
"""Targets per second."""
_FINE = 5
"""Number of interpolated samples for each target; what the filter gets."""
_WINDOW = 0.1
"""Length of the filter, s: it passes motions up to some 10 Hz, and not the steps of an encoder."""
_ORDER = 3
_SHORTEST = 2.0 * _WINDOW
_TOLERANCE = 1e-3
"""How far a measured position may be beyond a limit, rad or m."""


@dataclass(frozen=True)
class RecordedMotion:
    """A motion from recorded positions.

    Attributes:
        joints: names.
        time: of the targets, s, from 0, shape (targets,).
        position, velocity, acceleration: shape (targets, joints), rad or m, and per s and s^2.
    """

    joints: tuple[str, ...]
    time: Array
    position: Array
    velocity: Array
    acceleration: Array

    @property
    def duration(self) -> float:
        """s."""
        return float(self.time[-1])


def recorded_motion(joints: tuple[str, ...], time: Array, position: Array, speed: float = 1.0) -> RecordedMotion:
    """The motion through recorded positions, `RATE` targets per second, smoothed with a filter of Savitzky and Golay.

    Args:
        joints: names.
        time: s, increasing, shape (samples,).
        position: rad or m, shape (samples, joints).
        speed: of the motion; 2: twice as fast as it was recorded.

    Raises:
        TrajectoryError: the recording is too short.
    """
    lasts = (time[-1] - time[0]) / speed if time.size else 0.0
    if not lasts >= _SHORTEST:
        raise TrajectoryError(f"the motion lasts {lasts:.3g} s; it must last at least {_SHORTEST:g} s")
    step = 1.0 / (RATE * _FINE)
    fine = np.arange(0.0, lasts + 0.5 * step, step)
    fine_position = np.stack([np.interp(fine, (time - time[0]) / speed, column) for column in position.T], axis=1)
    window = round(_WINDOW / step) | 1  # It must be odd.
    smooth = [savgol_filter(fine_position, window, _ORDER, derivative, step, axis=0) for derivative in range(3)]
    q, dq, ddq = (values[::_FINE] for values in smooth)
    return RecordedMotion(joints, fine[::_FINE], q, dq, ddq)


def share_of_velocity(motion: RecordedMotion, limits: MotionLimits) -> Array:
    """Largest velocity of each joint, as a share of what a motion may have, shape (joints,); over 1: it is too fast.

    Args:
        motion: the motion, with the joints of the limits.
        limits: of the arm.
    """
    return np.asarray(np.abs(motion.velocity).max(axis=0) / limits.planned_velocity)


def beyond_range(motion: RecordedMotion, limits: MotionLimits) -> str:
    """The first joint that leaves its range, with the position, as the begin of a sentence; empty: none does."""
    for j, joint in enumerate(motion.joints):
        low, high = motion.position[:, j].min(), motion.position[:, j].max()
        if not limits.continuous[j] and (low < limits.lower[j] - _TOLERANCE or high > limits.upper[j] + _TOLERANCE):
            allowed = f"{limits.lower[j]:.4g} to {limits.upper[j]:.4g} {limits.units[j].position}"
            return f"{joint} moves from {low:.4g} to {high:.4g}, allowed {allowed}"
    return ""


def largest_effort(motion: RecordedMotion, limits: MotionLimits) -> Array | None:
    """Largest effort of each joint by the model, without friction, shape (joints,); None: no model is known."""
    if limits.model is None:
        return None
    largest, effort = np.zeros(len(motion.joints)), np.zeros((1, len(motion.joints)))
    order = limits.places
    for q, dq, ddq in zip(motion.position, motion.velocity, motion.acceleration, strict=True):
        inverse_dynamics(limits.model, q[order], dq[order], ddq[order][np.newaxis], effort)
        largest[order] = np.maximum(largest[order], np.abs(effort[0]))
    return largest
