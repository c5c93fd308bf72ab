"""The article's reaching law in the closed loop, with a wrong model."""

from typing import Any

import numpy as np

from pidtsm_core.parameters import Array
from pidtsm_core.rollout import rollout


def torque_variation(controller: dict[str, Any], simulator: dict[str, Any]) -> Array:
    """Mean |tau_k - tau_(k-1)| of Case 1, shape (joints,), N m."""
    run = rollout({"controller": controller, "simulator": simulator}, 30.0)
    return np.abs(np.diff(run.effort, axis=0)).mean(axis=0)


def test_in_the_layer_masses_far_off_do_not_make_the_torque_chatter(practical: dict[str, Any]) -> None:
    swapped = {"robot.m1": 1.5, "robot.m2": 0.5}
    nominal = torque_variation(practical, {})
    assert (torque_variation(practical, swapped) <= 2.0 * nominal).all()
    # Without the layer, the torque chatters.
    assert (torque_variation({**practical, "law.layer": 0.0}, swapped) > 2.0 * nominal).all()
