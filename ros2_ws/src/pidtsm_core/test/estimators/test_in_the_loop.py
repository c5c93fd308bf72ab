"""Every estimator in the closed loop, with its default parameters: in the article's Case 1, and with other arms."""

import numpy as np
import pytest
from support.testarms import TWO_LINK, Arm

from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.recording import Recording
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Signal


def roll(arm: Arm, estimator: str, **simulator: float) -> Recording:
    settings = arm.motion()
    settings["controller"] |= {"estimator.name": estimator, **(arm.gains() or {"law.gain_maximum": 20.0})}
    settings["simulator"] |= {name.replace("__", "."): value for name, value in simulator.items()}
    return rollout(**settings, duration=15.0 if arm is TWO_LINK else 8.0)


def settled_error(result: Recording) -> float:
    settled = result.time >= 2.0 / 3.0 * result.time[-1]
    return float(np.abs(result.position - result.reference[:, 0])[settled].max())


@pytest.mark.parametrize("estimator", ESTIMATORS.names)
def test_with_ideal_sensors_the_arm_follows_within_half_a_milliradian(arm: Arm, estimator: str) -> None:
    assert settled_error(roll(arm, estimator)) < 5e-4


@pytest.mark.parametrize("estimator", ["extended_state_observer", "robust_differentiator"])
@pytest.mark.parametrize(
    "sensors",
    [
        {"encoder__bits": 17},
        {"encoder__bits": 14, "delay__samples": 1, "dropout__probability": 0.05},
    ],
    ids=["17 bits", "14 bits, delay, losses"],
)
def test_with_real_sensors_it_still_follows_where_the_filtered_difference_does_not(
    arm: Arm, estimator: str, sensors: dict[str, float]
) -> None:
    result = roll(arm, estimator, **sensors)
    assert settled_error(result) < 0.02 < settled_error(roll(arm, "filtered_difference", **sensors))
    assert not result.signals[2000:, Signal.SATURATED].any()
