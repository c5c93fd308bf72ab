"""The arm under commission: where positions come from and torques go, and the wiring between."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError


class CommissionError(UsageError):
    """A step that cannot be completed; the message says why and what a person can do."""


class StoppedError(CommissionError):
    """The controller has stopped the arm, which it holds; a firmer or a softer one may follow."""


class Measured(NamedTuple):
    """A joint state.

    Attributes:
        stamp: ns.
        position: rad or m, shape (joints,).
    """

    stamp: int
    position: Array


class Port(Protocol):
    """An arm that gives positions and takes torques; before the first command something else carries it."""

    @property
    def period(self) -> float:
        """Nominal time between joint states, s."""

    def sense(self) -> Measured | None:
        """Wait for the next joint state; None: this one was lost.

        Raises:
            CommissionError: no joint state comes any more, or a person wants to stop.
        """

    def act(self, effort: Array | None) -> None:
        """Answer the joint state with torques, shape (joints,), N m or N; None: with nothing."""


@dataclass(frozen=True)
class Wiring:
    """How joints of the description and those of the arm's messages belong together; arrays of shape (joints,).

    Attributes:
        position: 1, or -1 where a position counts in the other direction.
        effort: the same of the torques.
    """

    position: Array
    effort: Array

    @classmethod
    def described(cls, joints: int) -> "Wiring":
        """That of the description."""
        return cls(np.ones(joints), np.ones(joints))

    @property
    def is_described(self) -> bool:
        """Whether nothing is inverted."""
        return bool(np.all(self.position > 0.0) and np.all(self.effort > 0.0))


class Wired:
    """A port with a wiring: positions and torques of `port` in the directions of the description."""

    def __init__(self, port: Port, wiring: Wiring) -> None:
        self._port, self.wiring = port, wiring

    @property
    def period(self) -> float:
        """See `Port`."""
        return self._port.period

    def sense(self) -> Measured | None:
        """See `Port`."""
        measured = self._port.sense()
        return measured and Measured(measured.stamp, self.wiring.position * measured.position)

    def act(self, effort: Array | None) -> None:
        """See `Port`."""
        self._port.act(None if effort is None else self.wiring.effort * effort)
