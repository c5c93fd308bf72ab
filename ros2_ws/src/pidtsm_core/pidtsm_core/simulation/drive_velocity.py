"""The velocity that the drives of a simulated arm report: an estimate from their encoders, as in real drives."""

import math

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.compiling.decorators import njit


@njit
def _follow(q: Array, last: Array, velocity: Array, dt: float, forget: float) -> None:
    """Low-pass the difference of the position; `forget` is what remains of the last estimate."""
    for j in range(q.size):
        velocity[j] = forget * velocity[j] + (1.0 - forget) * (q[j] - last[j]) / dt
        last[j] = q[j]


class DriveVelocity:
    """First-order low-pass, discretised exactly, of the differences of the measured position.

    It lags behind the motion by 1 / cutoff, and has the noise of the encoders.

    Attributes:
        velocity: the estimate, shape (joints,), in rad/s, or m/s of a joint that slides; 0 at the first measurement.
    """

    def __init__(self, joints: int, cutoff: float) -> None:
        """Compile the filter.

        Args:
            joints: number of joints.
            cutoff: of the filter, rad/s.
        """
        self.velocity, self._last = np.zeros(joints), np.zeros(joints)
        self._cutoff = cutoff
        self._time = -math.inf
        _follow(self._last, self._last, self.velocity, 1.0, 1.0)

    def measure(self, time: float, position: Array) -> None:
        """Take a measurement.

        Args:
            time: of its acquisition, s; one that is not later than the last starts at rest again.
            position: measured, shape (joints,), rad or m.
        """
        dt = time - self._time
        if 0.0 < dt < math.inf:
            _follow(position, self._last, self.velocity, dt, math.exp(-self._cutoff * dt))
        elif dt:
            self._last[:] = position
            self.velocity[:] = 0.0
        self._time = time

    def reset(self) -> None:
        """Forget all measurements, after a jump of the arm."""
        self._time = -math.inf
