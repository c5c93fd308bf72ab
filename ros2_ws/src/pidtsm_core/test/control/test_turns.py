"""Continuous joints: a turn more or less is the same position."""

import math

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.parameters import resolve
from pidtsm_core.signals import Mode, Signal, Status
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema

MS = 1_000_000
LINK = (
    '<link name="{0}"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>'
    '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><axis xyz="0 0 1"/>'
    '<limit effort="50" velocity="20" lower="-7" upper="7"/></joint>'
)
ARM = (
    f'<robot name="turner">{"".join(LINK.format(name) for name in ("a", "b"))}<link name="base"/>'
    f"{JOINT.format('endless', 'continuous', 'base', 'a')}{JOINT.format('ended', 'revolute', 'a', 'b')}</robot>"
)


def drive(
    start: tuple[float, float], ms: int, first: float, speed: float = 0.0, wrapped: bool = False
) -> tuple[Array, Array, Controller]:
    """Positions of the arm and errors of the controller, one every ms.

    The reference of the first joint starts at `first` and turns at `speed` (rad/s), within one turn if `wrapped`; so
    does its encoder.
    """
    changes = {"robot.description": ARM, "robot.armature": 0.1}
    controller = Controller(resolve(controller_schema, {**changes, "activation.distance": 4.0}, 2))
    robot = SimulatedRobot(resolve(simulator_schema, {**changes, "initial_position": start}, 2))
    positions, errors = np.zeros((2, ms, 2))
    for k in range(ms):
        q = robot.state.arm.position.copy()
        positions[k] = q
        controller.position[:] = q - 2.0 * math.pi * np.round(q / (2.0 * math.pi)) * [wrapped, 0.0]
        controller.reference[:] = 0.0
        desired = first + speed * 1e-3 * k
        controller.reference[0] = math.remainder(desired, 2.0 * math.pi) if wrapped else desired, start[1]
        controller.reference[1, 0] = speed
        assert not controller.refusal(referred=True)
        controller.step(1 + k * MS, 1 + k * MS)
        assert controller.status[Status.FAULT] == 0
        errors[k] = controller.signals[Signal.POSITION_ERROR]
        robot.act(k, True, controller.effort)
    return positions, errors, controller


@pytest.mark.parametrize("turns", [-3, -1, 0, 1, 2])
@pytest.mark.parametrize("to", [-3.0, 0.5, 3.0])
def test_the_arm_takes_the_short_way_to_a_reference(turns: int, to: float) -> None:
    start = 2.5
    positions, errors, controller = drive((start, 0.3), 3000, to + 2.0 * math.pi * turns)
    way = math.remainder(to - start, 2.0 * math.pi)
    assert positions[-1, 0] == pytest.approx(start + way, abs=1e-3)
    assert np.abs(positions[:, 0] - start).max() < abs(way) + 0.05
    assert np.abs(errors[-1]).max() < 1e-3
    assert controller.status[Status.MODE] == Mode.FOLLOWING


@pytest.mark.parametrize("wrapped", [False, True], ids=["many turns", "angles within a turn"])
def test_a_reference_within_one_turn_may_go_round_for_ever(wrapped: bool) -> None:
    speed = 4.0
    positions, errors, _ = drive((0.0, 0.3), 5000, 0.0, speed, wrapped)
    assert positions[-1, 0] == pytest.approx(speed * 4.999, abs=1e-3)
    assert np.abs(np.diff(positions[:, 0])).max() < 3e-3 * speed
    assert np.abs(errors[2000:]).max() < 1e-3


def test_a_joint_with_limits_is_not_turned() -> None:
    changes = {"robot.description": ARM, "activation.distance": 1.0}
    controller = Controller(resolve(controller_schema, changes, 2))
    controller.reference[0] = 2.0 * math.pi
    assert controller.refusal(referred=True).startswith("ended is 6.28 rad from its reference")
