"""Implausible measurements."""

from typing import Any

import numpy as np
import pytest
from support.pairs import paired
from support.testarms import Arm

from pidtsm_core.control import Count
from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.signals import Fault, Mode, Status

TOLERATED = 5
ESTIMATOR = pytest.mark.parametrize("estimator", [e.name for e in ESTIMATORS.members if not e.needs_truth])
RATE = pytest.mark.parametrize("rate", [100, 1000])


def of(estimator: str, rate: int) -> dict[str, Any]:
    """Parameters that choose an estimator, and tell it the rate if it wants to know."""
    told = {"estimator__rate": float(rate)} if "rate" in {p.name for p in ESTIMATORS[estimator].parameters} else {}
    return {"estimator__name": estimator, **told}


@ESTIMATOR
@paired("rate,off,samples", [100, 1000] * 3, [0.3, 1.0, -1e3], [1, 1, 1, TOLERATED, TOLERATED, TOLERATED])
def test_a_few_samples_far_off_move_no_torque(
    loop_of: Any, estimator: str, rate: int, samples: int, off: float
) -> None:
    loop = loop_of(2000, rate=rate, **of(estimator, rate))
    for _ in range(3):
        loop.measure(samples, off)
        loop.go_on(50 * loop.every)
    # The torque of the motion itself changes by less than this.
    assert loop.largest_step(since=-200) < 0.06
    assert loop.controller.status[Status.MODE] == Mode.FOLLOWING
    assert loop.controller.state.counts[Count.IMPLAUSIBLE] == 3 * samples
    undisturbed = loop_of(loop.ms, rate=rate, **of(estimator, rate))
    assert np.abs(loop.positions[-1] - undisturbed.positions[-1]).max() < 1e-3


@ESTIMATOR
@RATE
def test_a_sensor_that_stays_far_off_is_a_fault_that_names_the_joint(loop_of: Any, estimator: str, rate: int) -> None:
    loop = loop_of(2000, rate=rate, **of(estimator, rate))
    loop.measure(TOLERATED + 1, 1.0)
    assert loop.controller.status[:3] == (Mode.STOPPED, Fault.MEASUREMENT, loop.arm.joints)
    assert f"{loop.arm.names[-1]} has implausible measurements" in loop.controller.changes([0, 0, 0, 0, 0])[0].text
    # The new measurements hold the arm, and a single sample far from them is replaced as before.
    loop.measure(20, 1.0)
    loop.measure(1, 3.0)
    loop.measure(100, 1.0)
    assert loop.largest_step(since=-120) < 0.1


def test_the_samples_of_each_joint_count_alone(loop_of: Any) -> None:
    """Sensors that are wrong one after the other, each for a few samples, are no fault."""
    loop = loop_of(100)
    for joint in range(loop.arm.joints):
        loop.measure(TOLERATED, 1.0, joint)
    assert loop.controller.state.counts[Count.IMPLAUSIBLE] == TOLERATED * loop.arm.joints
    assert loop.controller.fault == Fault.NO_FAULT


def test_measurements_of_an_unchecked_joint_are_accepted(arm: Arm, loop_of: Any) -> None:
    loop = loop_of(100, plausibility__velocity=[*[20.0] * (arm.joints - 1), 0.0])
    loop.measure(TOLERATED + 5, 1.0)
    assert loop.controller.fault == Fault.NO_FAULT
    assert loop.controller.state.counts[Count.IMPLAUSIBLE] == 0


@pytest.mark.parametrize("gap", [2, 10, 15])
def test_after_a_gap_the_arm_may_be_farther(loop_of: Any, gap: int) -> None:
    loop = loop_of(500)
    loop.silent = True
    loop.go_on(gap)
    loop.silent = False
    loop.measure(1, 0.015 * gap)
    assert loop.controller.state.counts[Count.IMPLAUSIBLE] == 0
    assert np.isfinite(loop.controller.effort).all()
