"""The verdict on one cause, with its evidence."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from pidtsm_core.arrays import Array
from pidtsm_studies.diagnosis.causes import Cause
from pidtsm_studies.diagnosis.loop import Loop


class State(str, Enum):
    """What a detector says."""

    FOUND = "found"
    FINE = "fine"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Curve:
    """A curve of a plot: what `y` is over `x`, shape (points,) each; `points`: as points only."""

    label: str
    x: Array
    y: Array
    points: bool = False


@dataclass(frozen=True)
class Plot:
    """Evidence: curves over a common axis, with the labels of both axes."""

    title: str
    x_label: str
    y_label: str
    curves: Sequence[Curve]
    logarithmic: bool = False


@dataclass(frozen=True)
class Verdict:
    """What was found of a cause.

    Attributes:
        cause: which.
        state: found, fine, or unknown because something was not recorded.
        joints: those that have it, the worst first; empty: the whole arm, or none.
        value: the figure that decides.
        limit: the figure from which on it counts as found.
        unit: of both; empty: a share.
        text: a sentence without a full stop.
        cure: command or parameter that helps; empty: nothing to do.
        plots: the evidence.
    """

    cause: Cause
    state: State
    text: str
    joints: tuple[str, ...] = ()
    value: float = 0.0
    limit: float = 0.0
    unit: str = ""
    cure: str = ""
    plots: tuple[Plot, ...] = ()

    @property
    def found(self) -> bool:
        """Whether something is wrong."""
        return self.state is State.FOUND


def unknown(cause: Cause, why: str) -> Verdict:
    """The verdict on a cause that the recording does not show."""
    return Verdict(cause, State.UNKNOWN, why)


def too_short(loop: Loop) -> str:
    """Why nothing can be said of a loop that has stopped soon."""
    return f"the loop has followed for only {loop.followed:.2g} s before it stopped"
