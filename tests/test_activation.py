"""How the controller takes an arm over, and how it leaves it."""

import numpy as np
import pytest
from support.rig import ControllerRig, gravity, safe_effort
from support.testbed import Testbed

from pidtsm_msgs.msg import ControllerState

PATIENT = "watchdog.state_stop:=30.0"
"""A machine that stalls is no fault here."""
FAR = (0.6, -0.5)


@pytest.fixture
def rig(testbed: Testbed) -> ControllerRig:
    return ControllerRig(testbed, PATIENT)


def test_it_begins_by_holding_the_arm_where_it_is(rig: ControllerRig) -> None:
    rig.referred = False
    rig.begin()
    first = rig.step()
    assert first.mode == ControllerState.HOLDING
    np.testing.assert_allclose(first.effort, gravity(rig.start), rtol=1e-9)


def test_a_reference_far_away_is_approached_without_a_step_of_torque(rig: ControllerRig) -> None:
    rig.begin()
    states = [rig.step(rig.start, desired=FAR) for _ in range(30)]
    assert states[-1].mode == ControllerState.FOLLOWING
    assert np.abs(np.diff([state.effort for state in states], axis=0)).max() < 10.0


def test_the_rate_of_the_torque_can_be_limited(rig: ControllerRig) -> None:
    rig.testbed.set("controller", {"limits.effort_rate": 1000.0, "activation.blend": 0.0})
    rig.begin()
    efforts = [rig.step(rig.start, desired=FAR).effort for _ in range(30)]
    assert np.abs(np.diff(efforts, axis=0)).max() <= 1.0 + 1e-9
    assert np.abs(efforts[-1] - gravity(rig.start)).max() > 5.0


def test_its_last_torque_carries_the_arm(rig: ControllerRig) -> None:
    state = rig.step(desired=FAR)
    heard = rig.watch.heard["joint_commands"]
    count = len(heard)
    rig.process.interrupt()
    rig.testbed.spin_until(lambda: len(heard) > count, "the last command")
    np.testing.assert_allclose(rig.watch.last("joint_commands").effort, safe_effort(state), rtol=1e-9)
    assert rig.process.wait() == 0
