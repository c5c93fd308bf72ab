"""A simulated arm under commission."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.experiment.definition import MEASUREMENT
from pidtsm_core.parameters import as_float, resolve
from pidtsm_core.robots import robot_joints
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema
from pidtsm_core.timing import period_nanoseconds
from pidtsm_studies.commissioning.arm import Measured, Wired, Wiring
from pidtsm_studies.commissioning.loop import Loop
from pidtsm_studies.commissioning.model import ArmModel
from pidtsm_studies.commissioning.signs import Signs, find_signs

TIMEOUT = {"command.timeout": 0.05}
"""Parameter of the simulator, s: without commands the brakes close soon, as they should."""


@dataclass(frozen=True)
class SimulatedArm:
    """An arm given by the parameters of the simulator, and by what is wrong with its wiring.

    Attributes:
        settings: parameters of the simulator that differ from those of a measurement.
        wiring: how the arm differs from its description.
    """

    settings: Mapping[str, Any]
    wiring: Wiring | None = None

    def signs(self, arm: Mapping[str, Any], tell: Callable[[str], None]) -> Signs:
        """See `session.Source`."""
        return find_signs(self.port(0), ArmModel(arm), tell)[0]

    def follower(self, step: int, wiring: Wiring) -> Loop:
        """See `session.Source`: each step begins with the arm at its initial position, so that it can be repeated."""
        return Loop(Wired(self.port(step), wiring))

    def port(self, step: int) -> "SimulatedPort":
        """The arm at its initial position, at rest, with closed brakes; each step has random numbers of its own."""
        return SimulatedPort(self, step)


class SimulatedPort:
    """See `Port`; one sample of the simulated robot is one joint state."""

    def __init__(self, arm: SimulatedArm, seed: int) -> None:
        joints = robot_joints(arm.settings)
        given = {**MEASUREMENT.defaults["simulator"], **TIMEOUT, **arm.settings}
        given["seed"] = int(given.get("seed", 1)) + seed
        values = resolve(simulator_schema, given, joints)
        self._robot = SimulatedRobot(values)
        self._nanoseconds = period_nanoseconds(int(as_float(values["rate"])))
        self._sample = 0
        self._wiring = arm.wiring or Wiring.described(self._robot.joints)
        self._effort = np.zeros(self._robot.joints)
        self.truth = self._robot.state.arm.position

    @property
    def period(self) -> float:
        """See `Port`."""
        return 1e-9 * self._nanoseconds

    def sense(self) -> Measured | None:
        """See `Port`."""
        acquired, position = self._robot.sense(self._sample)
        if acquired < 0:
            return None
        return Measured(acquired * self._nanoseconds, self._wiring.position * position)

    def act(self, effort: Array | None) -> None:
        """See `Port`."""
        if effort is not None:
            self._effort = self._wiring.effort * effort
        # Without a command the drives keep the last one.
        self._robot.act(self._sample, effort is not None, self._effort)
        self._sample += 1
