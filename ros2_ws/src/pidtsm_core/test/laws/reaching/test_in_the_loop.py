"""The article's reaching law in the closed loop, with a wrong model."""

from typing import Any

import numpy as np
from support.testarms import TWO_LINK, Arm

from pidtsm_core.arrays import Array
from pidtsm_core.rollouts.closed_loop import rollout


def torque_variation(arm: Arm, controller: dict[str, Any], simulator: dict[str, Any]) -> Array:
    """Mean |tau_k - tau_(k-1)| of the arm's motion once it is settled, shape (joints,), N m."""
    settings = arm.motion()
    settings["controller"] |= {**arm.practical, **controller}
    settings["simulator"] |= simulator
    run = rollout(**settings, duration=8.0)
    return np.abs(np.diff(run.effort[run.time >= 4.0], axis=0)).mean(axis=0)


def test_in_the_layer_masses_far_off_do_not_make_the_torque_chatter(arm: Arm) -> None:
    wrong = {"robot.m1": 1.5, "robot.m2": 0.5} if arm is TWO_LINK else {"model_error.mass": -0.3}
    nominal = torque_variation(arm, {}, {})
    assert (torque_variation(arm, {}, wrong) <= 2.0 * nominal).all()
    # Without the layer, the torque chatters.
    assert (torque_variation(arm, {"law.layer": 0.0}, wrong) > 2.0 * nominal).all()
