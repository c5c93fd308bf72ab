"""The rule of gains takes the class of hardware into account, so that every arm follows."""

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import PRACTICAL, make_experiment
from pidtsm_core.experiment.gains import first_gains
from pidtsm_core.experiment.hardware_classes import hardware_names
from pidtsm_core.experiment.hardware_gains import hardware_gains
from pidtsm_core.experiment.law_gains import Gain
from pidtsm_core.robots.source import ARMS
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Status


@pytest.mark.parametrize("hardware", hardware_names())
def test_every_arm_follows_stably(hardware: str) -> None:
    for arm in ARMS:
        run = rollout(make_experiment(None, robot=arm, hardware=hardware), duration=8.0)
        late = run.time >= 4.0
        assert not run.status[:, Status.FAULT].any(), arm
        assert np.abs(run.error[late]).max() < 0.1, arm
        # No vibration: the links move as smoothly as the motion demands.
        assert np.abs(np.diff(run.commanded_effort[late], axis=0)).mean() < 0.01 * np.abs(run.effort).max(), arm


def test_gains_that_are_named_are_used() -> None:
    with_class, named = (make_experiment(None, robot="panda", hardware="geared", params=p) for p in ((), PRACTICAL))
    assert with_class.settings == named.settings
    tuned = make_experiment(None, robot="panda", hardware="geared", params="tuned_14bit").settings["controller"]
    without = make_experiment(None, robot="panda", params="tuned_14bit").settings["controller"]
    assert tuned == without
    differentiated = make_experiment(
        None, robot="panda", hardware="geared", overrides=["controller.estimator.name=exact"]
    )
    assert "estimator.bandwidth" not in differentiated.settings["controller"]


def test_stiffer_gears_allow_faster_observers_up_to_those_of_a_rigid_arm() -> None:
    arm = {"robot.description": "panda"}
    simulator = make_experiment(None, robot="panda", hardware="geared").settings["simulator"]
    soft, hard, rigid = (
        (_bandwidth(hardware_gains(arm, {**simulator, "elasticity.stiffness": stiffness})))
        for stiffness in (2e3, 2e4, 0.0)
    )
    assert (soft <= hard).all()
    assert (soft < hard).any()
    assert (hard <= rigid).all()
    assert rigid == pytest.approx(_bandwidth(first_gains(arm, 17, 0.003, 500.0)))


def _bandwidth(gains: tuple[Gain, ...]) -> Array:
    return np.array(next(gain.value for gain in gains if gain.name == "estimator.bandwidth"))
