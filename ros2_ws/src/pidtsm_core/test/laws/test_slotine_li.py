"""What Slotine and Li prove of their law, on arms that MuJoCo moves and that differ from the model."""

from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.control import Controller, controller_schema
from pidtsm_core.identification.regressor import regressor
from pidtsm_core.laws import Demand
from pidtsm_core.parameters import as_float, joint_array, resolve
from pidtsm_core.robots import find_description
from pidtsm_core.robots.tree.layout import Column, place_of, rows, size
from pidtsm_core.robots.tree.unit_forces import LINK
from pidtsm_core.signals import Signal

HEAVIER = 0.3
"""By how much every link is heavier than in the model."""
LENGTHS = np.array([-2, 0, 0, 0, 2, 2, 2, 2, 2, 2])
"""Exponent of the length in the gain of each parameter of a link."""


class Plant:
    """An arm that MuJoCo moves under the efforts of a controller that sees everything."""

    def __init__(self, name: str, dt: float, **gains: float) -> None:
        self.description = find_description({"robot.description": name})
        self.dt, self.joints = dt, len(self.description.joints)
        self.model = mujoco.MjModel.from_xml_string(self.description.text)
        self.model.opt.timestep, self.model.opt.integrator = dt, mujoco.mjtIntegrator.mjINT_RK4
        self.model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
        self.model.dof_damping[:] = self.model.dof_frictionloss[:] = 0.0
        for row in rows(self.description.tree):
            self.model.dof_armature[int(row[Column.PLACE])] = row[Column.ARMATURE]
        self.model.body_mass[:] *= 1.0 + HEAVIER
        self.model.body_inertia[:] *= 1.0 + HEAVIER
        self.data = mujoco.MjData(self.model)
        settings = {
            "robot.description": name,
            "law.name": "slotine_li",
            "estimator.name": "exact",
            "limits.effort": 1e6,
            "compensation.coulomb": 0.0,
            "compensation.viscous": 0.0,
            **{f"law.{gain}": value for gain, value in gains.items()},
        }
        self.values = resolve(controller_schema, settings, self.joints)
        self.controller = Controller(self.values)
        self.centre = np.resize([0.3, -0.6], self.joints)
        self.data.qpos[:] = self.centre + 0.05

    def desired(self, t: float) -> Array:
        """Two sines for each joint: twelve parameters of a joint need more than one."""
        w = 2.0 * (1.0 + 0.37 * np.arange(self.joints))[:, np.newaxis] * [1.0, 2.3]
        a = np.array([0.3, 0.15]) / (1.0 + 0.2 * np.arange(self.joints))[:, np.newaxis]
        motion = np.array([a * np.sin(w * t), a * w * np.cos(w * t), -a * w**2 * np.sin(w * t)]).sum(axis=2)
        motion[0] += self.centre
        return motion

    def run(self, duration: float) -> Iterator[tuple[float, Array]]:
        """Time and signals of each sample, while the arm is where it was measured."""
        for k in range(round(duration / self.dt)):
            truth = self.controller.state.truth
            truth[0], truth[1] = self.data.qvel, self.data.qacc
            signals = self.controller.tick(self.data.qpos.copy(), self.desired(k * self.dt), self.dt if k else 0.0)
            yield k * self.dt, signals
            self.data.qfrc_applied[:] = signals[Signal.EFFORT]
            mujoco.mj_step(self.model, self.data)

    def inertia(self) -> Array:
        """MuJoCo's inertia matrix."""
        mujoco.mj_forward(self.model, self.data)
        columns = np.zeros((self.joints, self.joints))
        for column, unit in zip(columns, np.eye(self.joints), strict=True):
            mujoco.mj_mulM(self.model, self.data, column, unit)
        return columns

    @property
    def unknown(self) -> Array:
        """What is not learnt yet of each link, in the order of the rows, shape (joints, LINK)."""
        learnt = rows(self.controller.state.law_memory[: size(self.joints)])[:, Column.MASS : Column.ARMATURE]
        return np.asarray(learnt - HEAVIER * rows(self.description.tree)[:, Column.MASS : Column.ARMATURE])

    @property
    def friction(self) -> Array:
        """Viscous and Coulomb friction as learnt; the arm has none, shape (2, joints)."""
        begin = size(self.joints) + (LINK + 2) * self.joints
        return self.controller.state.law_memory[begin : begin + 2 * self.joints].reshape(2, self.joints)

    def energy(self, signals: Array, inertias: Array) -> float:
        """The Lyapunov function V; `inertias` of the model in the first posture, shape (joints,)."""
        s = signals[Signal.SLIDING_VARIABLE]
        gains = joint_array(self.values["law.adaptation"], self.joints) * inertias
        of_moment = gains[[place_of(self.description.tree, i) for i in range(self.joints)]] / 9.81**2
        of_links = of_moment[:, np.newaxis] * as_float(self.values["law.length"]) ** LENGTHS
        parameters = (self.unknown**2 / of_links).sum() + (self.friction**2 / gains).sum()
        return float(0.5 * (s @ self.inertia() @ s + parameters))


def first_inertias(plant: Plant) -> Array:
    """Of the model in the first posture."""
    tree = plant.description.tree
    motion = np.array([plant.data.qpos])
    at = [
        regressor(tree, motion, 0.0 * motion, unit[np.newaxis]) - regressor(tree, motion, 0.0 * motion, 0.0 * motion)
        for unit in np.eye(plant.joints)
    ]
    pi = np.zeros(at[0].shape[2])
    for row in rows(tree):
        place = int(row[Column.PLACE])
        pi[LINK * place : LINK * (place + 1)] = row[Column.MASS : Column.ARMATURE]
        pi[LINK * plant.joints + place] = row[Column.ARMATURE]
    return np.array([(y[0] @ pi)[j] for j, y in enumerate(at)])


@pytest.mark.parametrize("name", ["panda", "scara"])
def test_its_lyapunov_function_never_increases(name: str) -> None:
    for dt in (1e-3, 2.5e-4):
        plant = Plant(name, dt)
        inertias = first_inertias(plant)
        energies = np.array([plant.energy(y, inertias) for _, y in plant.run(1.0)])
        assert energies[-1] < energies[0]
        assert np.diff(energies).max() < 1e-3 * dt * energies[0]


def test_its_gradient_is_that_of_the_regressor() -> None:
    """With Christoffel's symbols; the friction of the reference is left out."""
    plant = Plant("panda", 1e-3)
    signals = [y.copy() for _, y in plant.run(0.01)][-1]
    q, dq, s = (signals[i] for i in (Signal.POSITION, Signal.VELOCITY, Signal.SLIDING_VARIABLE))
    v, dv = dq - s, plant.controller.state.demand[Demand.ACCELERATION]
    zero = np.zeros_like(q)
    parts = regressor(plant.description.tree, *np.array([[q] * 3, [zero, dq + v, dq - v], [dv, zero, zero]]))
    expected = s @ (parts[0] + 0.25 * (parts[1] - parts[2]))
    memory, begin = plant.controller.state.law_memory, size(plant.joints)
    found = memory[begin : begin + LINK * plant.joints].reshape(plant.joints, LINK)
    for i in range(plant.joints):
        j = place_of(plant.description.tree, i)
        np.testing.assert_allclose(found[i], expected[LINK * j : LINK * (j + 1)], rtol=1e-9, atol=1e-12)


def test_its_parameters_converge_if_the_motion_excites_them() -> None:
    """What matters of them: the efforts that they predict for any other motion.

    A joint whose link is light beside its rotor has nothing to learn.
    """
    plant = Plant("scara", 1e-3, adaptation=400.0)
    places = [place_of(plant.description.tree, i) for i in range(plant.joints)]
    others = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 50, plant.joints)) * np.reshape([1.0, 2.0, 5.0], (3, 1, 1))
    matrix = regressor(plant.description.tree, *others)[:, :, : LINK * plant.joints]

    def wrong() -> Array:
        """Largest error of a predicted effort of each joint."""
        by_joint = np.empty_like(plant.unknown)
        by_joint[places] = plant.unknown
        return np.asarray(np.abs(matrix @ by_joint.ravel()).max(axis=0))

    run = plant.run(60.0)
    next(run)
    first = wrong()
    for _ in run:
        pass
    matters = first > 0.01 * first.max()
    assert matters.sum() == 3
    assert (wrong() < 0.1 * first)[matters].all(), wrong() / first
