"""Integral sliding mode: s is zero from the first sample on."""

import numpy as np

from pidtsm_core.rollouts.closed_loop import rollout

GAINS = {"law.gain": 5.0, "law.width": 0.01, "estimator.name": "exact"}


def test_s_keeps_within_its_layer_in_spite_of_a_wrong_model() -> None:
    """Without a reaching phase; so the arm moves as computed torque moves one that is as described."""
    heavier = {"model_error.mass": 0.05, "model_error.inertia": 0.05}
    run = rollout(robot="panda", law="integral_sliding_mode", duration=2.0, simulator=heavier, controller=GAINS)
    exact = {"estimator.name": "exact"}
    alone = rollout(robot="panda", law="computed_torque", duration=2.0, simulator=heavier, controller=exact)
    assert not run.sliding_variable[0].any()
    assert np.abs(run.sliding_variable).max() < 0.01
    assert np.abs(run.error).max() < 0.4 * np.abs(alone.error).max()
