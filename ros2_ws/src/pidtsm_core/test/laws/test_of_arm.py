"""What laws of the whole arm promise together."""

import numpy as np
import pytest

from pidtsm_core.laws import LAWS
from pidtsm_core.rollouts.closed_loop import rollout

HEAVIER = {"model_error.mass": 0.2, "model_error.inertia": 0.2}
LEARNS = [law.name for law in LAWS.members if law.of_arm and law.name != "impedance"]  # It yields instead.
REJECTS = {"predictive", "integral_sliding_mode"}
"""Laws that learn nothing by themselves: their practical set lets the observer do so."""


@pytest.mark.parametrize("law", LEARNS)
def test_an_arm_that_is_heavier_than_its_model_is_followed_all_the_same(law: str) -> None:
    """With ideal sensors; computed torque without a disturbance observer is the measure."""
    errors = {}
    for name, rejects in ((law, law in REJECTS), ("computed_torque", False)):
        controller = {"law.disturbance_rejection": rejects} if LAWS[name].uses_model else {}
        run = rollout(
            robot="panda", law=name, params="practical", duration=5.0, simulator=HEAVIER, controller=controller
        )
        errors[name] = np.abs(run.error[run.time > 3.0]).max()
    assert errors[law] < 0.2 * errors["computed_torque"]
