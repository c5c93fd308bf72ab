"""What anybody can see of a loop: joint states and, if they were recorded, commands and references."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array
from pidtsm_core.units import JointUnits, joint_units


@dataclass(frozen=True)
class Observed:
    """A recording of a loop; arrays of shape (samples, joints) belong to `time`.

    Attributes:
        joints: names, in the order of the columns.
        time: stamps of the joint states, s, increasing, shape (samples,).
        position: measured, rad or m.
        effort: of the drives as reported, of the time before the stamp; of a loop whose drives report none, as
            commanded, N m or N.
        command: effort commanded in answer to each joint state, nan where there is none; None: not recorded.
        reference: desired position, rad or m, nan where there is none; None: not recorded.
        following: whether the controller follows its reference, shape (samples,); None: it does not say.
        slides: whether each joint slides; empty: all turn.
        stopped: why the controller has stopped; empty: it has not, or it is not known.
        effort_is_command: whether `effort` is what was commanded, because the drives report none.
    """

    joints: tuple[str, ...]
    time: Array
    position: Array
    effort: Array
    command: Array | None = None
    reference: Array | None = None
    following: NDArray[np.bool_] | None = None
    slides: tuple[bool, ...] = ()
    stopped: str = ""
    effort_is_command: bool = False

    @property
    def period(self) -> float:
        """The median of the periods, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def units(self) -> tuple[JointUnits, ...]:
        """Units of each joint."""
        return joint_units(self.slides, len(self.joints))

    def between(self, begin: float, end: float) -> "Observed":
        """The recording from one time (s) to another, without the state of the controller."""
        rows = (self.time >= begin) & (self.time <= end)
        return replace(
            self,
            time=self.time[rows],
            position=self.position[rows],
            effort=self.effort[rows],
            command=None if self.command is None else self.command[rows],
            reference=None if self.reference is None else self.reference[rows],
            following=None,
            stopped="",
        )

    def of(self, joints: tuple[str, ...]) -> "Observed":
        """The same with these joints in this order; each must be one of its own."""
        order = [self.joints.index(joint) for joint in joints]

        def columns(values: Array | None) -> Array | None:
            return None if values is None else values[:, order]

        return replace(
            self,
            joints=joints,
            position=self.position[:, order],
            effort=self.effort[:, order],
            command=columns(self.command),
            reference=columns(self.reference),
            slides=tuple(self.slides[i] for i in order) if self.slides else (),
        )
