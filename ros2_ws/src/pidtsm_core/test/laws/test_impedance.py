"""The tool in MuJoCo yields as the spring and damper that were asked for."""

import mujoco
import numpy as np
import pytest
import scipy.linalg
from scipy.spatial.transform import Rotation

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.parameters import resolve
from pidtsm_core.robots import find_description
from pidtsm_core.robots.tree.layout import Column, rows
from pidtsm_core.timing import NANOSECONDS

START = np.array([0.1, -0.3, 0.2, -2.2, 0.1, 2.0, 0.8])
STIFFNESS = np.array([500.0, 1000.0, 2000.0, 40.0, 40.0, 40.0])
RATIO = 0.3
DT = 1e-3


class Pressed:
    """A Panda that MuJoCo moves, and whose tool is pressed."""

    def __init__(self, **gains: float) -> None:
        description = find_description({"robot.description": "panda"})
        self.model = mujoco.MjModel.from_xml_string(description.text)
        self.model.opt.timestep, self.model.opt.integrator = DT, mujoco.mjtIntegrator.mjINT_RK4
        self.model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
        self.model.dof_damping[:] = self.model.dof_frictionloss[:] = 0.0
        for row in rows(description.tree):
            self.model.dof_armature[int(row[Column.PLACE])] = row[Column.ARMATURE]
        self.data = mujoco.MjData(self.model)
        self.body, self.offset = self.model.body("panda_link7").id, description.tool
        named = {f"law.stiffness_{axis}": value for axis, value in zip("xyz", STIFFNESS[:3], strict=True)}
        settings = {
            "robot.description": "panda",
            "law.name": "impedance",
            "estimator.name": "exact",
            "compensation.coulomb": 0.0,
            "compensation.viscous": 0.0,
            **named,
            "law.rotational_stiffness": STIFFNESS[3],
            "law.damping_ratio": RATIO,
            **gains,
        }
        self.values = resolve(controller_schema, settings, 7)
        self.controller, self.stamp = Controller(self.values), 0
        self.data.qpos[:] = START
        mujoco.mj_forward(self.model, self.data)
        self.place, self.axes = self.tool()

    def tool(self) -> tuple[Array, Array]:
        """Its position and axes. All axes of the Panda's joints are z, so MuJoCo's bodies have the tree's frames."""
        axes = self.data.xmat[self.body].reshape(3, 3).copy()
        return self.data.xpos[self.body] + axes @ self.offset, axes

    def run(self, wrench: Array, duration: float) -> tuple[Array, Array]:
        """Twist from the first pose to the tool's, and effort, of each sample, under this wrench on the tool."""
        poses, efforts = [], []
        desired = np.array([START, 0.0 * START, 0.0 * START])
        for _ in range(round(duration / DT)):
            truth = self.controller.state.truth
            truth[0], truth[1] = self.data.qvel, self.data.qacc
            self.controller.position[:] = self.data.qpos
            self.controller.reference[:] = desired
            self.stamp += round(DT * NANOSECONDS)
            self.controller.step(self.stamp, self.stamp)
            efforts.append(self.controller.effort.copy())
            self.data.qfrc_applied[:] = efforts[-1]
            pushed = self.data.qfrc_applied
            mujoco.mj_applyFT(self.model, self.data, wrench[:3], wrench[3:], self.tool()[0], self.body, pushed)
            mujoco.mj_step(self.model, self.data)
            place, axes = self.tool()
            turned = Rotation.from_matrix(axes @ self.axes.T).as_rotvec()
            poses.append(np.hstack((place - self.place, turned)))
        return np.array(poses), np.array(efforts)

    def modes(self) -> Array:
        """Displacements of the tool that move on their own, in columns, from MuJoCo's inertia and Jacobian."""
        inertia, jacobian = np.zeros((7, 7)), np.zeros((6, 7))
        for column, unit in zip(inertia, np.eye(7), strict=True):
            mujoco.mj_mulM(self.model, self.data, column, unit)
        mujoco.mj_jac(self.model, self.data, jacobian[:3], jacobian[3:], self.tool()[0], self.body)
        felt = np.linalg.inv(jacobian @ np.linalg.solve(inertia, jacobian.T))
        return np.asarray(scipy.linalg.eigh(np.diag(STIFFNESS), felt)[1])


@pytest.mark.parametrize("axis", [0, 2, 4])
def test_it_yields_by_the_force_over_the_stiffness(axis: int) -> None:
    arm, wrench = Pressed(**{"law.damping_ratio": 1.0}), np.zeros(6)
    wrench[axis] = 5e-3 * STIFFNESS[axis]
    moved = arm.run(wrench, 1.5)[0][-1]
    assert wrench[axis] / moved[axis] == pytest.approx(STIFFNESS[axis], rel=0.05)
    assert np.abs(np.delete(moved, axis)).max() < 0.05 * moved[axis]


@pytest.mark.parametrize("mode", [0, 3])
def test_it_returns_with_the_damping_ratio(mode: int) -> None:
    """Each mode overshoots by exp(-pi ratio / sqrt(1 - ratio^2))."""
    arm = Pressed()
    direction = arm.modes()[:, mode]
    direction *= 2e-3 / np.abs(direction).max()
    pressed = arm.run(STIFFNESS * direction, 3.0)[0][-1]
    measure = STIFFNESS * direction
    course = arm.run(np.zeros(6), 1.5)[0] @ measure / (pressed @ measure)
    decrement = -np.log(-course.min())
    assert decrement / np.hypot(np.pi, decrement) == pytest.approx(RATIO, rel=0.1)


def test_a_stiffness_that_changes_by_20_while_pressed_makes_no_step() -> None:
    arm, wrench = Pressed(**{"law.damping_ratio": 1.0}), np.array([10.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    before = arm.run(wrench, 1.5)[1][-1]
    for axis in "xyz":
        arm.values[f"law.stiffness_{axis}"] = 20.0 * STIFFNESS["xyz".index(axis)]
    arm.controller.set_parameters(arm.values)
    poses, efforts = arm.run(wrench, 2.0)
    assert np.abs(np.diff(np.vstack((before, efforts)), axis=0)).max() < 1.0
    assert wrench[0] / poses[-1, 0] == pytest.approx(20.0 * STIFFNESS[0], rel=0.05)


def test_the_force_stays_within_its_limit() -> None:
    """Beyond it, the tool goes on yielding."""
    arm = Pressed(**{"law.damping_ratio": 1.0, "law.force_limit": 20.0})
    arm.run(np.array([15.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 1.5)
    moved = arm.run(np.array([25.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.5)[0][:, 0]
    assert moved[0] == pytest.approx(15.0 / STIFFNESS[0], rel=0.05)
    assert moved[-1] > 1.1 * 20.0 / STIFFNESS[0]
