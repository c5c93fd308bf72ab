"""The article's reaching law in the closed loop, with a wrong model."""

from typing import Any

import numpy as np
from support.testarms import TWO_LINK, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.rollouts.closed_loop import rollout


def settled_torque(arm: Arm, controller: dict[str, Any], simulator: dict[str, Any]) -> Array:
    """Torque of the arm's motion once it is settled, shape (samples, joints), N m."""
    settings = arm.motion()
    settings["controller"] |= {**arm.practical, **controller}
    settings["simulator"] |= simulator
    run = rollout(**settings, duration=8.0)
    return run.effort[run.time >= 4.0]


def changes(torque: Array, order: int) -> Array:
    """Mean size of the differences from sample to sample, shape (joints,); motion hardly counts in the second order."""
    return np.abs(np.diff(torque, order, axis=0)).mean(axis=0)


def test_in_the_layer_masses_far_off_do_not_make_the_torque_chatter(arm: Arm) -> None:
    wrong = {"robot.m1": 1.5, "robot.m2": 0.5} if arm is TWO_LINK else {"model_error.mass": -0.3}
    torque = settled_torque(arm, {}, wrong)
    assert (changes(torque, 1) <= 2.0 * changes(settled_torque(arm, {}, {}), 1)).all()
    # Without the layer, the torque chatters.
    assert (changes(torque, 2) <= 0.25 * changes(settled_torque(arm, {"law.layer": 0.0}, wrong), 2)).all()
