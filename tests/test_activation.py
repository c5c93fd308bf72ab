"""How the controller takes an arm over, and how it leaves it."""

import numpy as np
import pytest
from bench import Bench
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rig import MS, NAMES, ControllerRig, gravity, safe_effort
from sensor_msgs.msg import JointState

from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.stamps import set_stamp

PATIENT = "watchdog.state_stop:=30.0"
"""A machine that stalls is no fault here."""
FAR = (0.6, -0.5)


def change(bench: Bench, transition: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=transition))
    return bool(bench.call(ChangeState, "controller/change_state", request).success)


@pytest.fixture
def rig(bench: Bench) -> ControllerRig:
    return ControllerRig(bench, PATIENT)


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
    rig.bench.set("controller", {"limits.effort_rate": 1000.0, "activation.blend": 0.0})
    rig.begin()
    efforts = [rig.step(rig.start, desired=FAR).effort for _ in range(30)]
    assert np.abs(np.diff(efforts, axis=0)).max() <= 1.0 + 1e-9
    assert np.abs(efforts[-1] - gravity(rig.start)).max() > 5.0


def test_its_last_torque_carries_the_arm(rig: ControllerRig) -> None:
    state = rig.step(desired=FAR)
    heard = rig.watch.heard["joint_commands"]
    count = len(heard)
    rig.process.interrupt()
    rig.bench.spin_until(lambda: len(heard) > count, "the last command")
    np.testing.assert_allclose(rig.watch.last("joint_commands").effort, safe_effort(state), rtol=1e-9)
    assert rig.process.wait() == 0


def test_without_a_joint_state_it_does_not_become_active(bench: Bench) -> None:
    process = bench.start("controller", "autostart:=false")
    assert change(bench, Transition.TRANSITION_CONFIGURE)
    assert not change(bench, Transition.TRANSITION_ACTIVATE)
    bench.spin_until(lambda: "not activated: no joint state received yet" in process.log.read_text(), "the reason")


def test_far_from_its_reference_it_does_not_become_active(bench: Bench) -> None:
    joint_states = bench.node.create_publisher(JointState, "joint_states", 10)
    references = bench.node.create_publisher(JointReference, "reference", 10)
    process = bench.start("controller", PATIENT, "activation.distance:=0.1", "autostart:=false")
    assert change(bench, Transition.TRANSITION_CONFIGURE)
    samples = iter(range(1_000_000))

    def refused() -> bool:
        state = JointState(name=NAMES, position=[0.2, -0.1])
        reference = JointReference(name=NAMES, position=[0.4, -0.1], velocity=[0.0, 0.0], acceleration=[0.0, 0.0])
        for publisher, message in ((references, reference), (joint_states, state)):
            set_stamp(message.header.stamp, next(samples) * MS)
            publisher.publish(message)
        if not joint_states.get_subscription_count() or not references.get_subscription_count():
            return False
        assert not change(bench, Transition.TRANSITION_ACTIVATE)
        return "joint1 is 0.2 rad from its reference (activation.distance 0.1)" in process.log.read_text()

    bench.spin_until(refused, "the reason")
