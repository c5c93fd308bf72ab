"""Motions as functions of time."""

from typing import Protocol

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.references.piecewise import evaluate
from pidtsm_core.references.polynomials import add_quintic, quintic

_SHORTEST_APPROACH = 1.0  # s
_APPROACH_VELOCITY = 0.5  # rad/s, mean velocity of the joint that moves farthest


class Motion(Protocol):
    """A desired motion."""

    def evaluate(self, t: float, desired: Array) -> None:
        """Write q_d, q_d', q_d'' at t (s) to desired, shape (3, joints), rad, rad/s, rad/s^2."""


class PiecewiseMotion:
    """A piecewise polynomial motion, at rest before its begin and after its end.

    Attributes:
        parameters: as `references.piecewise.piecewise` returns them, shape (joints, 7 segments + 1).
    """

    def __init__(self, parameters: Array) -> None:
        """Args: parameters: see the attribute."""
        self.parameters = parameters

    @property
    def segments(self) -> int:
        """Number of segments."""
        return (self.parameters.shape[1] - 1) // 7

    @property
    def times(self) -> Array:
        """Times at which segments begin and end, s, shape (segments + 1,)."""
        return self.parameters[0, : self.segments + 1]

    @property
    def begin(self) -> float:
        """Time of the first state, s."""
        return float(self.times[0])

    @property
    def end(self) -> float:
        """Time from which on the motion is at rest, s."""
        return float(self.times[-1])

    @property
    def coefficients(self) -> Array:
        """Coefficients of powers 0 to 5 of the share of a segment that has passed, shape (joints, segments, 6), rad."""
        return self.parameters[:, self.segments + 1 :].reshape(len(self.parameters), -1, 6)

    def stretched(self, factor: float) -> "PiecewiseMotion":
        """The same path from the same begin, slower by this factor."""
        parameters = self.parameters.copy()
        parameters[:, : self.segments + 1] = self.begin + factor * (self.times - self.begin)
        return PiecewiseMotion(parameters)

    def evaluate(self, t: float, desired: Array) -> None:
        """See `Motion.evaluate`."""
        evaluate(t, self.parameters, desired)


class Rest:
    """A constant position."""

    def __init__(self, position: Array) -> None:
        """Args: position: shape (joints,), rad."""
        self._position = position.copy()

    def evaluate(self, t: float, desired: Array) -> None:  # noqa: ARG002
        """See `Motion.evaluate`."""
        desired[0] = self._position
        desired[1:] = 0.0


class Approach:
    """A motion and the approach to it: a quintic reduces the difference from the present state to zero."""

    def __init__(self, motion: Motion, present: Array) -> None:
        """Args: motion: the motion, approached from its start; present: q, q', q'' at time 0, shape (3, joints)."""
        self._motion = motion
        difference = np.zeros_like(present)
        motion.evaluate(0.0, difference)
        np.subtract(present, difference, out=difference)
        self._duration = max(_SHORTEST_APPROACH, float(np.abs(difference[0]).max()) / _APPROACH_VELOCITY)
        self._way = np.zeros((6, present.shape[1]))
        quintic(difference, np.zeros_like(present), self._duration, self._way)

    def evaluate(self, t: float, desired: Array) -> None:
        """See `Motion.evaluate`."""
        self._motion.evaluate(t, desired)
        if t < self._duration:
            add_quintic(self._way, self._duration, t, desired)
