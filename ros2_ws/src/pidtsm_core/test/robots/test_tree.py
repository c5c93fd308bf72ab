"""Dynamics of trees of joints: equal to MuJoCo's and Pinocchio's."""

from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.arrays import Array
from pidtsm_core.robots import tree
from pidtsm_core.robots.description import Description, read_description
from pidtsm_core.robots.source import ARMS, read_source
from pidtsm_core.robots.tree.layout import Column, rows

RELATIVE = 1e-12
"""Largest difference, relative to the largest value."""


def difference(ours: Array, theirs: Array, terms: Array | float = 0.0) -> float:
    """Relative to the largest value, or to the largest of the terms that sum up to the values."""
    return float(np.abs(ours - theirs).max() / max(np.abs(theirs).max(), np.abs(terms).max()))


def judge(text: str) -> tuple[Any, Any]:
    """MuJoCo's model and data without what is not rigid-body dynamics."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    return model, mujoco.MjData(model)


def stripped(text: str) -> str:
    """The URDF as MuJoCo reads it: links without mass at the end of the chain stay, geometry goes."""
    start, end = text[: text.rindex("</robot>")], '<mujoco><compiler fusestatic="false"/></mujoco></robot>'
    return start + end


def ours(arm: Description, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array, Array]:
    """Effort for ddq, acceleration under this effort, and inertia matrix."""
    effort, back, inertia = np.full((1, q.size), np.nan), np.full(q.size, np.nan), np.full((q.size, q.size), np.nan)
    tree.inverse_dynamics(q, dq, ddq[np.newaxis], arm.tree, effort)
    tree.forward_dynamics(q, dq, effort[0], arm.tree, back)
    tree.inertia_matrix(q, arm.tree, inertia)
    return effort[0], back, inertia


def compare_with_mujoco(arm: Description, model: Any, data: Any, random: np.random.Generator) -> None:
    """One random state; the joints of the model are those of the arm, in any order."""
    n = len(arm.joints)
    order = np.array([model.joint(name).dofadr[0] for name in arm.joints])
    q, dq, ddq = random.uniform(-3.0, 3.0, (3, n))
    data.qpos[order], data.qvel[order], data.qacc[order] = q, dq, ddq
    mujoco.mj_inverse(model, data)
    inertia = np.zeros((n, n))
    mujoco.mj_fullM(model, data, inertia) if mujoco.__version__ >= "4" else mujoco.mj_fullM(model, inertia, data.qM)
    effort, back, matrix = ours(arm, q, dq, ddq)
    condition = np.linalg.cond(matrix)
    # Where M ddq and the other terms nearly cancel out, no algorithm is exact relative to the sum.
    assert difference(effort, data.qfrc_inverse[order], matrix @ ddq) < RELATIVE
    assert difference(matrix, inertia[np.ix_(order, order)]) < RELATIVE
    # What one algorithm makes of the other's result is as exact as the matrix is well-conditioned.
    assert np.abs(back - ddq).max() < RELATIVE * max(1.0, condition * np.abs(ddq).max() / 100.0)
    placements = np.full((n, 3, 4), np.nan)
    tree.forward_kinematics(q, arm.tree, placements)
    for row, placement in zip(rows(arm.tree), placements, strict=True):
        joint = model.joint(arm.joints[int(row[Column.PLACE])])
        np.testing.assert_allclose(placement[:, 2], data.xaxis[joint.id], atol=1e-12)
        if not row[Column.SLIDES]:
            np.testing.assert_allclose(placement[:, 3], data.xanchor[joint.id], atol=1e-11)


@pytest.mark.parametrize("name", ARMS)
def test_the_arms_have_the_dynamics_that_mujoco_computes(name: str) -> None:
    text = read_source(name)[1]
    arm, random = read_description(text), np.random.default_rng(0)
    model, data = judge(stripped(text))
    for row in rows(arm.tree):
        model.dof_armature[model.joint(arm.joints[int(row[Column.PLACE])]).dofadr] = row[Column.ARMATURE]
    for _ in range(1000):
        compare_with_mujoco(arm, model, data, random)


@pytest.mark.parametrize("name", ARMS)
def test_the_arms_have_the_dynamics_that_pinocchio_computes(name: str) -> None:
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio is not installed, see requirements/README.md")
    text = read_source(name)[1]
    arm, random = read_description(text), np.random.default_rng(1)
    model = pinocchio.buildModelFromXML(text)
    data = model.createData()
    assert tuple(model.names)[1:] == arm.joints
    model.armature = np.array([row[Column.ARMATURE] for row in rows(arm.tree)])
    for _ in range(1000):
        q, dq, ddq = random.uniform(-3.0, 3.0, (3, len(arm.joints)))
        effort, back, matrix = ours(arm, q, dq, ddq)
        assert difference(effort, pinocchio.rnea(model, data, q, dq, ddq)) < RELATIVE
        assert difference(back, pinocchio.aba(model, data, q, dq, effort)) < RELATIVE * np.linalg.cond(matrix)
        upper = pinocchio.crba(model, data, q)
        assert difference(np.triu(matrix), np.triu(upper)) < RELATIVE


def random_tree(random: np.random.Generator, joints: int) -> str:
    """MJCF of a tree with random shape, joint types, axes, placements, inertias and rotor inertias."""
    bodies: list[list[str]] = [[] for _ in range(joints + 1)]
    for i in range(joints, 0, -1):
        numbers = {name: random.normal(size=3) for name in ("pos", "axis", "joint", "centre")}
        axis = numbers["axis"] / np.linalg.norm(numbers["axis"])
        kind = random.choice(["hinge", "slide"], p=[0.7, 0.3])
        a, b = random.uniform(0.01, 1.0, 2)
        principal = a, b, random.uniform(abs(a - b), a + b)  # the triangle inequality
        text = {name: " ".join(map(repr, map(float, values))) for name, values in numbers.items()}
        bodies[random.integers(0, i)].append(
            f'<body name="b{i}" pos="{text["pos"]}" quat="{_text(random.normal(size=4))}">'
            f'<joint name="j{i}" type="{kind}" axis="{_text(axis)}" pos="{text["joint"]}" '
            f'armature="{random.choice([0.0, random.uniform(0.0, 0.5)])}"/>'
            f'<inertial mass="{random.uniform(0.1, 5.0)}" pos="{text["centre"]}" quat="{_text(random.normal(size=4))}" '
            f'diaginertia="{_text(principal)}"/>' + "".join(bodies[i]) + "</body>"
        )
    return f'<mujoco><option gravity="1 -2 -9"/><worldbody>{"".join(bodies[0])}</worldbody></mujoco>'


def _text(numbers: Any) -> str:
    return " ".join(repr(float(number)) for number in numbers)


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), joints=st.integers(1, 12))
def test_any_tree_in_any_order_has_the_dynamics_that_mujoco_computes(seed: int, joints: int) -> None:
    random = np.random.default_rng(seed)
    text = random_tree(random, joints)
    arm = read_description(text, random.permutation([f"j{i}" for i in range(1, joints + 1)]).tolist())
    model, data = judge(text)
    for _ in range(3):
        compare_with_mujoco(arm, model, data, random)
