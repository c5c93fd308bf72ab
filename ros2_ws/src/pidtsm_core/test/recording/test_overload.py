"""A joint whose effort limit is too low is named, with the reason."""

from typing import Any

import pytest
from support.testarms import Arm

from pidtsm_core.recording.outcome import verdict, what_happened, why_not_followed
from pidtsm_core.rollouts.closed_loop import rollout


def weak(arm: Arm, share: float, joint: int, **controller: Any) -> dict[str, Any]:
    """Metrics of the arm's motion if a joint has this share of the effort that it needs at rest."""
    settings = arm.motion()
    limits = arm.limits.copy()
    limits[joint] = share * abs(arm.effort(arm.start)[joint])
    settings["controller"] |= {"limits.effort": limits.tolist(), **controller}
    return rollout(**settings, duration=5.0).metrics()


@pytest.mark.parametrize("share", [0.3, 0.8])
def test_a_joint_that_cannot_carry_the_arm_is_named_with_its_figures(arm: Arm, share: float) -> None:
    needed = abs(arm.effort(arm.start))
    joint = int(needed.argmax())
    values = weak(arm, share, joint)
    assert values["outcome"] in ("overloaded", "ran away")
    assert values["overloaded"]["joint"] == arm.robot.joints[joint]
    assert values["overloaded"]["at_rest"] > values["overloaded"]["limit"] == pytest.approx(share * needed[joint])
    assert f"{arm.robot.joints[joint]} cannot carry the arm: " in verdict(values) == why_not_followed(values)
    assert verdict(values) in what_happened(values)


def test_a_run_that_reaches_no_limit_is_not_overloaded(arm: Arm) -> None:
    settings = arm.motion()
    settings["controller"] |= arm.practical
    values = rollout(**settings, duration=2.0).metrics()
    assert values["overloaded"] is None
    assert verdict(values).startswith("followed; within ")
