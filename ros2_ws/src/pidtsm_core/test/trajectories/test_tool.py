"""The tool: where it is, and how it comes somewhere."""

import mujoco
import numpy as np
import pytest
from support.testarms import TWO_LINK, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.control import controller_schema
from pidtsm_core.robots import NAMES, find_robot
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_core.trajectories.limits import motion_limits
from pidtsm_core.trajectories.tool import inverse_kinematics, tool_pose


def postures(arm: Arm, count: int) -> Array:
    """Random postures within the position limits, shape (count, joints)."""
    limits = motion_limits(arm.settings)
    low, high = np.maximum(limits.lower, -3.0), np.minimum(limits.upper, 3.0)
    return np.asarray(low + np.random.default_rng(2).random((count, arm.joints)) * (high - low))


def named(name: str) -> Arm:
    return Arm(name, find_robot({"robot.description": name}).initial_position)


def test_the_tool_of_the_panda_is_where_mujoco_computes_it() -> None:
    panda = named("panda")
    robot, values = panda.robot, panda.values(controller_schema, {})
    description = robot.description  # type: ignore[attr-defined]
    end = description.text.rindex("</robot>")
    text = description.text[:end] + '<mujoco><compiler fusestatic="false"/></mujoco></robot>'
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    for q in postures(panda, 5):
        data.qpos[:7] = q
        mujoco.mj_kinematics(model, data)
        body = data.body(description.links.names[description.tool_link])
        position, rotation = tool_pose(robot, values, q)
        np.testing.assert_allclose(position, body.xpos, atol=1e-12)
        np.testing.assert_allclose(rotation, body.xmat.reshape(3, 3), atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_joints_are_found_for_poses_that_the_tool_can_have(name: str) -> None:
    arm = named(name)
    values, limits = arm.values(controller_schema, {}), motion_limits(arm.settings)
    for q in postures(arm, 3):
        position, rotation = tool_pose(arm.robot, values, q)
        for wanted in (None, rotation) if arm.joints >= 6 else (None,):
            found = inverse_kinematics(arm.robot, values, position, wanted)
            there, axes = tool_pose(arm.robot, values, found)
            np.testing.assert_allclose(there, position, atol=1e-8)
            if wanted is not None:
                np.testing.assert_allclose(axes, rotation, atol=1e-8)
            assert (found >= limits.lower).all()
            assert (found <= limits.upper).all()


def test_the_result_stays_near_the_start(arm: Arm) -> None:
    values, start = arm.values(controller_schema, {}), np.array(arm.start)
    position, _ = tool_pose(arm.robot, values, start + 0.01)
    found = inverse_kinematics(arm.robot, values, position, start=start)
    assert np.abs(found - start).max() < 0.1


def test_a_pose_out_of_reach_is_refused_with_its_distance() -> None:
    values = TWO_LINK.values(controller_schema, {})
    with pytest.raises(TrajectoryError, match=r"two_link cannot reach \(3, 0, 0\) m; .* differs by 1\.15 "):
        inverse_kinematics(TWO_LINK.robot, values, np.array([3.0, 0.0, 0.0]))
