"""A change of the payload that the controller knows, spread over time so that the torque has no step."""

from collections.abc import Mapping

import numpy as np

from pidtsm_core.control.controller import Controller
from pidtsm_core.parameters import Value
from pidtsm_core.robots import find_robot
from pidtsm_core.robots.payload import Payload

DURATION = 1.0
"""s; even 20 kg at 1 m then change a torque by less than 0.5 N m from one millisecond to the next."""


class PayloadBlend:
    """Leads the model of a controller from the payload that it knows to another one.

    Inertias and first moments of mass act linearly, so a model in between is that of a possible body.
    """

    def __init__(self, controller: Controller, values: Mapping[str, Value], payload: Payload) -> None:
        """Begin.

        Args:
            controller: its model is changed by `advance`.
            values: every parameter of the controller.
            payload: the other payload.
        """
        robot = find_robot(values)
        self.payload = payload
        self._controller = controller
        self._before = controller.config.model.parameters.copy()
        self._after = robot.with_payload(robot.pack_model(values), payload)
        self._passed = 0.0

    @property
    def done(self) -> bool:
        """Whether the model is that of the other payload."""
        return self._passed >= DURATION

    def advance(self, dt: float) -> None:
        """Let a time pass (s); with 0, write the model again after something else has changed it."""
        self._passed = min(self._passed + dt, DURATION)
        s = self._passed / DURATION
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        np.copyto(self._controller.config.model.parameters, self._before + share * (self._after - self._before))
