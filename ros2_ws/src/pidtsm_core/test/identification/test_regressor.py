"""The regressor and its base parameters give the efforts of the inverse dynamics, for every arm."""

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.identification.base_parameters import base_parameters
from pidtsm_core.identification.regressor import described_parameters, parameter_names, regressor
from pidtsm_core.robots import NAMES, Description, find_description, find_robot, inverse_dynamics, make_model, tree
from pidtsm_core.robots.two_link import TWO_LINK


def random_motion(joints: int) -> Array:
    """q, q', q'' of 20 samples, shape (3, 20, joints)."""
    return np.random.default_rng(0).uniform(-2.0, 2.0, (3, 20, joints))


def rigid_efforts(arm: Description, motion: Array) -> Array:
    efforts = np.empty_like(motion[0])
    for q, dq, ddq, effort in zip(*motion, efforts, strict=True):
        tree.inverse_dynamics(q, dq, ddq[np.newaxis], arm.tree, effort[np.newaxis])
    return efforts


@pytest.mark.parametrize("name", NAMES)
def test_regressor_times_parameters_is_the_effort_of_the_inverse_dynamics(name: str) -> None:
    arm = find_description({"robot.description": name})
    joints = len(arm.joints)
    viscous, coulomb, offset = np.random.default_rng(1).uniform(0.1, 2.0, (3, joints))
    motion = random_motion(joints)
    pi = described_parameters(arm.tree, viscous, coulomb)
    assert len(parameter_names(arm.joints)) == pi.size
    pi[-joints:] = offset
    friction = viscous * motion[1] + coulomb * np.tanh(motion[1] / 0.01) + offset
    expected = rigid_efforts(arm, motion) + friction
    np.testing.assert_allclose(regressor(arm.tree, *motion) @ pi, expected, rtol=0, atol=1e-10)


def test_regressor_of_the_two_link_arm_gives_the_closed_form() -> None:
    arm, robot = find_description({"robot.description": "two_link"}), find_robot({})
    assert robot is TWO_LINK
    values = {f"robot.{p.name}": p.default for p in robot.parameters} | {"robot.coriolis": "lagrange", "robot.g": 9.81}
    model, motion = make_model(robot, robot.pack_model(values)), random_motion(2)
    pi = described_parameters(arm.tree, np.zeros(2), np.zeros(2))
    pi[20:22] = 5.0, 5.0  # The URDF has no rotors.
    expected = np.empty_like(motion[0])
    for q, dq, ddq, effort in zip(*motion, expected, strict=True):
        inverse_dynamics(model, q, dq, ddq[np.newaxis], effort[np.newaxis])
    np.testing.assert_allclose(regressor(arm.tree, *motion) @ pi, expected, rtol=0, atol=1e-7)


@pytest.mark.parametrize("name", NAMES)
def test_base_parameters_give_the_same_efforts_and_are_independent(name: str) -> None:
    arm = find_description({"robot.description": name})
    joints = len(arm.joints)
    base, matrix = base_parameters(arm.tree, joints), regressor(arm.tree, *random_motion(joints))
    pi = np.random.default_rng(2).normal(size=matrix.shape[2])
    expected = matrix @ pi
    atol = 1e-4 * np.abs(expected).max()
    np.testing.assert_allclose(matrix[..., base.columns] @ (base.mapping @ pi), expected, rtol=0, atol=atol)
    kept = matrix[..., base.columns].reshape(-1, base.columns.size)
    assert np.linalg.cond(kept / np.linalg.norm(kept, axis=0)) < 1e3
    assert kept.shape[1] == len(base.texts(parameter_names(arm.joints)))


def test_the_number_of_base_parameters_is_that_of_the_literature() -> None:
    """Inertial parameters of a serial arm with rotors, without friction and offset of each joint."""
    panda = find_description({"robot.description": "panda"})
    names = parameter_names(panda.joints)
    base = base_parameters(panda.tree, 7)
    inertial = [i for i in base.columns if i < 7 * 10]
    # 43 of a seven-jointed arm without rotors (Gaz et al., RA-L 4, 2019). The rotors of the first two joints add none.
    assert len(inertial) + sum(7 * 10 <= i < 7 * 11 for i in base.columns) == 43 + 5
    assert "panda_joint1.m" in base.without_effect(names)
    assert "panda_joint2.armature" in base.only_combined(names)
