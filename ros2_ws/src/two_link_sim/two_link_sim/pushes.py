"""Pushes on the tool of the simulated arm that arrive as messages."""

import numpy as np
from geometry_msgs.msg import WrenchStamped

from pidtsm_core.arrays import Array
from pidtsm_core.parameters.joints import ABSURD, MessageError
from pidtsm_core.simulation.simulator import SimulatedRobot
from pidtsm_core.timing import NANOSECONDS

TOPIC = "~/push"
LASTS = 0.1
"""How long a wrench acts after its message, s of simulated time; the next message ends it."""


class Pushes:
    """The wrench on the tool: that of the last message, for `LASTS`."""

    def __init__(self, base: str, period: int) -> None:
        """Args: base: name of the base link; period: of the samples, ns."""
        self._base = base
        self._samples = max(1, round(LASTS * NANOSECONDS / period))
        self._left = 0
        self._acting = False
        self._wrench: Array = np.zeros(6)

    def take(self, message: WrenchStamped) -> None:
        """Begin a push.

        Raises:
            MessageError: the wrench is not finite or absurd, or in the axes of another frame than the base.
        """
        frame = message.header.frame_id
        if frame not in ("", "world", self._base):
            raise MessageError(f"the wrench is in the axes of {frame!r}; it must be in those of {self._base}")
        force, torque = message.wrench.force, message.wrench.torque
        wrench = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
        if not (np.abs(wrench) < ABSURD).all():
            raise MessageError("the wrench is not finite, or absurd")
        self._wrench, self._left = wrench, self._samples

    def act(self, robot: SimulatedRobot) -> None:
        """Push the arm over the next sample, or let it go; call it once for every sample, before `robot.act`."""
        if self._left > 0:
            robot.push(self._wrench)
        elif self._acting:
            robot.push(np.zeros(6))
        self._acting = self._left > 0
        self._left = max(self._left - 1, 0)
