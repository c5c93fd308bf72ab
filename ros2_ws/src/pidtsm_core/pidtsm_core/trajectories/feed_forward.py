"""Efforts that are fed forward along a trajectory."""

import numpy as np

from pidtsm_core.arrays import Array

FADE = 0.5
"""Time in which an effort fades that is no longer commanded, s."""


class FeedForward:
    """Efforts on straight lines between points in time; the last one stays."""

    def __init__(self, times: Array, efforts: Array) -> None:
        """Args: times: s, increasing, shape (n,); efforts: shape (n, joints), N m."""
        self._times, self._efforts = times, efforts

    def evaluate(self, t: float) -> Array:
        """Efforts at t (s), shape (joints,), N m."""
        if t >= self._times[-1]:
            return self._efforts[-1]
        return np.array([np.interp(t, self._times, effort) for effort in self._efforts.T])


def fade(begin: float, present: Array) -> FeedForward:
    """From the `present` effort, shape (joints,), N m, at `begin` (s) to zero."""
    return FeedForward(np.array([begin, begin + FADE]), np.array([present, np.zeros_like(present)]))


def follow(begin: float, present: Array, times: Array, efforts: Array) -> FeedForward:
    """From the `present` effort, shape (joints,), N m, at `begin` (s) to those of the later points.

    Args:
        begin: s.
        present: shape (joints,), N m.
        times: of the points, s, increasing, shape (n,); the last one is later than `begin`.
        efforts: of the points, shape (n, joints), N m.
    """
    later = times > begin
    return FeedForward(np.concatenate([[begin], times[later]]), np.vstack([present, efforts[later]]))
