"""Rigid joints beside elastic ones, such as those that slide."""

import numpy as np

from pidtsm_core.experiment.definition import MEASUREMENT
from pidtsm_core.experiment.hardware_classes import hardware_settings
from pidtsm_core.parameters import resolve
from pidtsm_core.robots import robot_joints
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema


def test_brakes_hold_a_rigid_joint_that_was_falling_when_they_closed() -> None:
    arm = ArmDefinition("scara").settings()
    given = {**MEASUREMENT.defaults["simulator"], **arm, **hardware_settings("collaborative", arm)}
    given |= {"command.timeout": 0.02, "friction.coulomb": 0.0, "friction.static": 0.0}
    robot = SimulatedRobot(resolve(simulator_schema, given, robot_joints(arm)))
    positions = []
    for sample in range(400):
        positions.append(robot.sense(sample)[1].copy())
        robot.act(sample, sample < 50, np.zeros(4))  # The vertical joint falls, until the commands cease.
    assert positions[50][2] < positions[0][2] - 0.005
    assert np.ptp([each[2] for each in positions[100:]]) < 1e-4
