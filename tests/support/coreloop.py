"""Controller, arm and motion in a loop of the tests' own, which can look at the controller's state."""

from typing import Any

import numpy as np

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller
from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.definition import MEASUREMENT
from pidtsm_core.references import ReferenceMotion
from pidtsm_core.simulation.simulator import SimulatedRobot

PERIOD = 1e-3  # s


class CoreLoop:
    """The loop of an arm with the `practical` set, at 1 kHz.

    Attributes:
        controller, robot, motion: its parts.
        values: every parameter of the controller.
        errors, delivered: of the last samples, shape (samples, joints): error of the true position (rad), and what the
            controller believes that the drives have delivered (N m).
    """

    def __init__(self, robot: str, controller: dict[str, Any], simulator: dict[str, Any]) -> None:
        given = {"controller": controller, "simulator": simulator}
        values = make_experiment(None, None, 10.0, "practical", given, robot, purpose=MEASUREMENT).values
        self.controller, self.robot = Controller(values["controller"]), SimulatedRobot(values["simulator"])
        self.motion, self.sample = ReferenceMotion(values["trajectory"]), 0
        self.values = values["controller"]
        self.errors = self.delivered = np.empty((0, self.controller.joints))

    def advance(self, samples: int) -> Array:
        """Returns the commands, shape (samples, joints), N m."""
        efforts, self.errors, self.delivered = np.empty((3, samples, self.controller.joints))
        desired = np.empty((3, self.controller.joints))
        for k in range(samples):
            sample, position = self.robot.sense(self.sample)
            self.motion.evaluate(self.sample * PERIOD, desired)
            self.errors[k] = self.robot.state.arm.position - desired[0]
            if sample >= 0:
                self.motion.evaluate(sample * PERIOD, self.controller.reference)
                self.controller.position[:] = position
                self.controller.step(sample * 1_000_000, sample * 1_000_000)
            self.robot.act(self.sample, sample >= 0, self.controller.effort)
            efforts[k], self.delivered[k] = self.controller.effort, self.controller.state.delivered
            self.sample += 1
        return efforts
