"""The observer of elastic joints: against MuJoCo, where motors are bodies of their own, and after bad measurements."""

from typing import Any

import numpy as np
import pytest
from support.testarms import ROTOR, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.estimators import Sample
from pidtsm_core.estimators.elastic_joints import ELASTIC_JOINT_OBSERVER
from pidtsm_core.experiment import make_experiment
from pidtsm_core.parameters.family import SLOTS
from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout

DT = 0.001


def roll(encoder: str, **controller: Any) -> Recording:
    """A Panda on soft springs, moved by MuJoCo without friction and noise."""
    joints = 7
    stiffness = np.linspace(3000.0, 1000.0, joints).tolist()
    simulator = {
        "engine": "mujoco",
        "elasticity.stiffness": stiffness,
        "elasticity.damping": 2.0,
        "elasticity.encoder": encoder,
        "friction.viscous": 0.0,
    }
    own = {
        "estimator.name": "elastic_joint_observer",
        "estimator.bandwidth": 30.0,
        "estimator.stiffness": stiffness,
        "estimator.damping": 2.0,
        "estimator.at_links": encoder == "link",
        "law.disturbance_rejection": True,
        "law.kp": 60.0,
        "law.kd": 15.0,
        "compensation.viscous": 0.0,
    }
    overrides = {"simulator": simulator, "controller": own | controller}
    return rollout(make_experiment(None, "computed_torque", robot="panda", overrides=overrides), duration=6.0)


@pytest.mark.parametrize("encoder", ["motor", "link"])
def test_it_finds_where_the_links_are(encoder: str) -> None:
    run = roll(encoder)
    late = run.time >= 3.0
    assert np.abs(run.estimated_position - run.position)[late].max() < 1e-4
    assert np.abs(run.estimated_velocity - run.velocity)[late].max() < 5e-3


def test_one_that_takes_the_joints_for_rigid_finds_the_motors() -> None:
    run = roll("motor", **{"estimator.stiffness": 0.0, "estimator.bandwidth": 20.0, "law.kp": 10.0, "law.kd": 6.0})
    late = run.time >= 3.0
    assert np.abs(run.estimated_position - run.position)[late].max() > 5e-3


def observe(arm: Arm, positions: Array, dts: Array) -> Array:
    """Estimates after each sample, shape (samples, 3, joints), of an arm without masses that has soft joints."""
    joints = arm.joints
    values = {f"estimator.{each.name}": each.default for each in ELASTIC_JOINT_OBSERVER.parameters}
    values |= {"estimator.stiffness": 15_000.0, "estimator.damping": 20.0, "estimator.bandwidth": 60.0}
    p = ELASTIC_JOINT_OBSERVER.make_parameters(values, np.full(joints, 0.2 * ROTOR), np.full(joints, ROTOR))
    assert ELASTIC_JOINT_OBSERVER.rows is not None
    x = np.zeros((joints + ELASTIC_JOINT_OBSERVER.rows(joints), SLOTS))
    estimates, effort, truth = np.zeros((len(positions), 3, joints)), np.zeros(joints), np.zeros((2, joints))
    for k, q in enumerate(positions):
        ELASTIC_JOINT_OBSERVER.estimate(Sample(q, truth, float(dts[k]), effort, arm.free, 1.0), p, x, estimates[k])
    return estimates


@pytest.mark.parametrize("absurd", [1e3, 1e30, 1e160, 1e300, -1.7e308])
def test_after_an_absurd_measurement_the_arm_counts_as_at_rest_and_is_found_again(arm: Arm, absurd: float) -> None:
    positions = np.zeros((3000, arm.joints))
    positions[10] = absurd
    estimates = observe(arm, positions, np.full(3000, DT))
    assert np.isfinite(estimates).all()
    np.testing.assert_allclose(estimates[-1], 0.0, atol=1e-6)


@pytest.mark.parametrize("bandwidth", [1e-6, 1e3, 4e18])
@pytest.mark.parametrize("stiffness", [1e-9, 1e4, 4e18])
@pytest.mark.parametrize("damping", [0.0, 1e9, 4e18])
@pytest.mark.parametrize("rate", [1.0, 500.0, 1e9])
def test_there_are_gains_for_any_parameters(bandwidth: float, stiffness: float, damping: float, rate: float) -> None:
    """Also while the arm moves: a change must not stop a node."""
    given = {"bandwidth": bandwidth, "stiffness": stiffness, "damping": damping, "rate": rate, "at_links": False}
    values = {f"estimator.{name}": value for name, value in given.items()}
    for rotor, inertia in ((1e-9, 1.0), (0.1, 1.0), (1.0, 1.0), (1e-6, 1e18)):
        p = ELASTIC_JOINT_OBSERVER.make_parameters(values, np.full(2, rotor), np.full(2, inertia))
        assert np.isfinite(p).all()


def test_more_samples_than_its_rate_do_not_make_it_faster(arm: Arm) -> None:
    """After a step of the position, it has gone as far as with samples at its rate."""
    found = []
    for every in (1, 4):
        count = 200 * every
        positions = np.full((count, arm.joints), 0.01)
        positions[0] = 0.0
        found.append(observe(arm, positions, np.full(count, DT / every))[20 * every, 0])
    np.testing.assert_allclose(found[1], found[0], rtol=0.1)
