"""Wrenches on the tool, compared with MuJoCo's Jacobian."""

import mujoco
import numpy as np
import pytest
from support.testarms import Arm

from pidtsm_core.control import controller_schema
from pidtsm_core.robots.tree import add_wrench
from pidtsm_core.simulation.mujoco_plant import MujocoArm
from pidtsm_core.simulation.plant import plant_schema

FACTORS = {"mass": 1.0, "inertia": 1.0, "length": 1.0}


@pytest.mark.parametrize("part", [slice(0, 3), slice(3, 6)], ids=["force", "torque"])
def test_a_wrench_on_the_tool_acts_as_in_mujoco(arm: Arm, part: slice) -> None:
    twin = MujocoArm(arm.values(plant_schema, {"engine": "mujoco"}), FACTORS, np.zeros(arm.joints))
    twin.data.qpos[twin.config.positions] = arm.start
    mujoco.mj_forward(twin.models.empty, twin.data)
    jacobians = np.zeros((2, 3, twin.models.empty.nv))
    mujoco.mj_jacSite(twin.models.empty, twin.data, *jacobians, twin.models.empty.site("pidtsm_tool").id)
    jacobian = jacobians.reshape(6, -1)[:, twin.config.velocities]
    assert arm.robot.tool is not None
    tool = arm.robot.tool(arm.robot.pack_model(arm.values(controller_schema, {})))
    wrench = np.zeros(6)
    wrench[part] = 3.0, -2.0, 5.0
    efforts = np.ones(arm.joints)
    add_wrench(np.array(arm.start), *tool, wrench, np.zeros((arm.joints, 3, 4)), efforts)
    np.testing.assert_allclose(efforts, 1.0 + jacobian.T @ wrench, atol=1e-12)
    assert np.abs(efforts - 1.0).max() > 1e-3
