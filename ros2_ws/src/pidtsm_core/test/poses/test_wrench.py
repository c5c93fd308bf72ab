"""The wrench on the tool is that which MuJoCo computes at the contact, without a sensor of forces."""

from pathlib import Path

import numpy as np

import pidtsm_core as pidtsm
from pidtsm_core.arrays import Array
from pidtsm_core.control.state import External
from pidtsm_core.parameters import resolve
from pidtsm_core.poses.kinematics import ToolKinematics
from pidtsm_core.poses.wrench import ToolWrench
from pidtsm_core.robots import find_robot
from pidtsm_core.simulation.simulator import SimulatedRobot, simulator_schema
from pidtsm_core.trajectories.limits import motion_limits
from pidtsm_core.trajectories.tool import inverse_kinematics, tool_pose

WALL = '<mujoco><worldbody><geom type="box" size="0.05 1 1" pos="0.62 0 0.5"/></worldbody></mujoco>'
START = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.8])
STEP = 1_000_000


def pressed(tmp_path: Path, depth: float, simulator: dict[str, object], seconds: float) -> tuple[Array, Array]:
    """Estimated and true force on the tool in the base axes, shape (samples, 3), while the reference is in a wall."""
    (tmp_path / "wall.xml").write_text(WALL, encoding="utf-8")
    arm = {"robot.description": "panda"}
    given = {**arm, "engine": "mujoco", "scene": str(tmp_path / "wall.xml"), "initial_position": START.tolist()}
    robot = SimulatedRobot(resolve(simulator_schema, {**given, "disturbance.name": "none", **simulator}, 7))
    controller = pidtsm.make_controller(robot="panda", params="practical")
    values = resolve(simulator_schema, given, 7)
    panda = find_robot(arm)
    wrench, links = ToolWrench(panda, values), ToolKinematics(panda, motion_limits(arm))
    position, rotation = tool_pose(panda, values, START)
    goal = inverse_kinematics(panda, values, position + np.array([depth, 0.0, 0.0]), rotation, START)
    found, true = [], []
    for k in range(round(seconds * 1e3)):
        share = min(1e-3 * k / 2.0, 1.0)
        way, rate = share * share * (3.0 - 2.0 * share), 6.0 * share * (1.0 - share) / 2.0
        controller.reference[:3] = START + way * (goal - START), rate * (goal - START), np.zeros(7)
        _, measured = robot.sense(k)
        controller.position[:] = measured
        controller.step(k * STEP, k * STEP)
        robot.act(k, True, controller.effort)
        _, axes = tool_pose(panda, values, measured)
        felt = wrench.of(measured, controller.state.external[External.TWICE])
        found.append(axes @ felt[:3])
        on_links = np.zeros(3)
        for link, force in robot.contacts().items():
            on_links = on_links + links.pose(measured, link).rotation @ force[:3]
        true.append(on_links)
    return np.array(found), np.array(true)


def test_a_force_on_the_tool_is_that_of_the_contact(tmp_path: Path) -> None:
    found, true = pressed(tmp_path, 0.12, {}, 3.0)
    assert np.abs(true[2500]).max() > 100.0
    np.testing.assert_allclose(found[:900], 0.0, atol=0.1)
    np.testing.assert_allclose(found[2500:], true[2500:], atol=1.0)


def test_with_a_wrong_model_and_friction_it_is_right_within_a_tenth(tmp_path: Path) -> None:
    """Masses are 20 % wrong, and every joint has 1 N m of friction."""
    found, true = pressed(tmp_path, 0.12, {"model_error.mass": 0.2, "friction.coulomb": 1.0}, 3.0)
    missed = np.linalg.norm(found[2500:] - true[2500:], axis=1)
    assert (missed < 0.1 * np.linalg.norm(true[2500:], axis=1)).all()
