"""What the controller does when something goes wrong around it: each fault, and the reaction expected."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from bench import Bench
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from pidtsm_core.robots.two_link import TWO_LINK
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.stamps import set_stamp

NAMES = ["joint1", "joint2"]
LIMITS = np.array([100.0, 50.0])
START = [0.2, -0.1]
STOP = 5.0  # s: far more than a busy machine takes between two messages of the test


def gravity(position: list[float]) -> Any:
    values = {f"robot.{p.name}": p.default for p in TWO_LINK.parameters}
    effort = np.zeros((1, 2))
    TWO_LINK.inverse_dynamics(np.array(position), np.zeros(2), np.zeros((1, 2)), TWO_LINK.pack_model(values), effort)
    return effort[0]


def change(bench: Bench, transition: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=transition))
    return bool(bench.call(ChangeState, "controller/change_state", request).success)


@dataclass
class Rig:
    """A controller that takes the newest reference, and a test that is its arm; time is what the test says it is."""

    bench: Bench
    parameters: tuple[str, ...] = ()
    wait: bool = True
    time: float = 10.0
    commands: list[JointState] = field(default_factory=list)
    states: list[ControllerState] = field(default_factory=list)

    def __post_init__(self) -> None:
        node = self.bench.node
        self.joint_states = node.create_publisher(JointState, "joint_states", 10)
        self.references = node.create_publisher(JointReference, "reference", 10)
        node.create_subscription(JointState, "joint_commands", self.commands.append, 10)
        node.create_subscription(ControllerState, "controller/state", self.states.append, 10)
        self.process = self.bench.start("controller", f"watchdog.state_stop:={STOP}", *self.parameters)
        if self.wait:
            self.connect()

    def connect(self) -> None:
        self.bench.spin_until(
            lambda: self.joint_states.get_subscription_count() and self.references.get_subscription_count(),
            "the controller",
        )

    def refer(self, position: list[float]) -> None:
        message = JointReference(name=NAMES, position=position, velocity=[0.0, 0.0], acceleration=[0.0, 0.0])
        set_stamp(message.header.stamp, round(self.time * 1e9))
        self.references.publish(message)

    def step(self, position: list[float], dt: float = 0.001) -> ControllerState:
        """A joint state dt later, and what the controller makes of it."""
        self.time += dt
        before = len(self.states), len(self.commands)
        message = JointState(name=NAMES, position=position)
        set_stamp(message.header.stamp, round(self.time * 1e9))
        self.joint_states.publish(message)
        self.bench.spin_until(
            lambda: len(self.states) > before[0] and len(self.commands) > before[1], f"an answer at {self.time:.3f} s"
        )
        effort = np.array(self.commands[-1].effort)
        assert np.all(np.abs(effort) <= LIMITS), "no torque beyond a limit is ever published"
        assert np.isfinite(effort).all()
        return self.states[-1]

    def follow(self, position: list[float]) -> ControllerState:
        """Joint states until a reference here is followed."""
        state = self.step(position)
        for _ in range(100):
            self.refer(position)
            state = self.step(position)
            if state.mode == ControllerState.FOLLOWING:
                return state
        pytest.fail("the reference is not followed")

    def reset(self) -> Trigger.Response:
        return self.bench.call(Trigger, "controller/reset_fault", Trigger.Request())

    def says(self, text: str) -> None:
        self.bench.spin_until(lambda: text in self.process.log.read_text(), f"{text!r} in the log")


@pytest.fixture
def rig(bench: Bench) -> Rig:
    return Rig(bench)


def test_it_begins_by_holding_the_arm_where_it_is(rig: Rig) -> None:
    rig.says("configured")
    first = rig.step(START)
    assert first.mode == ControllerState.HOLDING
    np.testing.assert_allclose(first.effort, gravity(START), rtol=1e-9)


def test_a_reference_far_away_is_approached_without_a_step_of_torque(rig: Rig) -> None:
    last = np.array(rig.step(START).effort)
    for _ in range(30):
        rig.refer([0.6, -0.5])
        effort = np.array(rig.step(START).effort)
        assert np.abs(effort - last).max() < 10.0
        last = effort
    assert rig.states[-1].mode == ControllerState.FOLLOWING


@pytest.mark.parametrize(("lost", "stops"), [(1, False), (5, False), (20, False), (6000, True)])
def test_joint_states_that_are_lost(rig: Rig, lost: int, stops: bool) -> None:
    rig.follow(START)
    rig.refer(START)
    state = rig.step(START, 0.001 * (lost + 1))
    assert (state.mode == ControllerState.STOPPED) == stops
    assert (state.fault == ControllerState.STATE_STALE) == stops
    if stops:
        np.testing.assert_allclose(state.effort, gravity(START), rtol=1e-6)
        rig.says("stopped: no joint state for 6 s")


def test_an_old_reference_is_not_followed_and_a_new_one_is(rig: Rig) -> None:
    rig.follow(START)
    state = rig.step(START, 0.2)
    assert state.mode == ControllerState.HOLDING
    np.testing.assert_allclose(state.effort, gravity(START), atol=1e-3)
    rig.says("holding position: the reference is 0.2")
    assert rig.follow(START).mode == ControllerState.FOLLOWING


def test_stamps_that_go_back_are_refused_and_a_source_started_anew_is_not(rig: Rig) -> None:
    rig.follow(START)
    message = JointState(name=NAMES, position=START)
    set_stamp(message.header.stamp, round((rig.time - 0.5) * 1e9))
    rig.joint_states.publish(message)
    rig.says("rejected joint_states: the stamp goes back")
    assert rig.step(START).mode == ControllerState.FOLLOWING
    state = rig.step(START, -5.0)
    assert state.mode == ControllerState.HOLDING
    np.testing.assert_allclose(state.effort, gravity(START), rtol=1e-9)
    rig.says("time went back: starting afresh")


LIMITED = {
    "position": ("limits.position:=0.5", ControllerState.POSITION_LIMIT, [0.6, -0.1]),
    "velocity": ("limits.velocity:=1.0", ControllerState.VELOCITY_LIMIT, [0.21, -0.1]),
    "tracking_error": ("limits.tracking_error:=0.1", ControllerState.TRACKING_LIMIT, [0.35, -0.1]),
}


@pytest.mark.parametrize("limit", LIMITED)
def test_beyond_a_limit_it_stops_until_it_is_reset(bench: Bench, limit: str) -> None:
    parameter, fault, beyond = LIMITED[limit]
    rig = Rig(bench, (parameter,))
    rig.follow(START)
    assert not rig.reset().success
    state = rig.step(beyond)
    assert (state.mode, state.fault) == (ControllerState.STOPPED, fault)
    rig.says(f"stopped: a joint is beyond limits.{limit}")
    # Latched: back within the limits it stays so, with a torque that carries the arm.
    for _ in range(3):
        rig.refer(START)
        state = rig.step(START)
    assert (state.mode, state.fault) == (ControllerState.STOPPED, fault)
    assert rig.reset().success
    assert rig.follow(START).fault == ControllerState.NO_FAULT


def test_a_limit_may_only_warn(bench: Bench) -> None:
    rig = Rig(bench, ("limits.position:=0.5", "limits.position_action:=warn"))
    rig.follow(START)
    rig.refer(START)
    assert rig.step([0.6, -0.1]).mode == ControllerState.FOLLOWING
    rig.says("a joint is beyond limits.position")


def test_the_rate_of_the_torque_can_be_limited(bench: Bench) -> None:
    rig = Rig(bench, ("limits.effort_rate:=1000.0", "activation.blend:=0.0"))
    last = np.array(rig.step(START).effort)
    for _ in range(20):
        rig.refer([0.6, -0.5])
        effort = np.array(rig.step(START).effort)
        assert np.abs(effort - last).max() <= 1.0 + 1e-9
        last = effort
    assert np.abs(last - gravity(START)).max() > 5.0


def test_silence_stops_the_arm(bench: Bench) -> None:
    rig = Rig(bench, ("watchdog.state_stop:=0.3",))
    rig.follow(START)
    rig.says("stopped: no joint state for")
    np.testing.assert_allclose(rig.commands[-1].effort, gravity(START), atol=0.1)
    assert not rig.reset().success, "nothing has come since"


def test_without_a_joint_state_it_does_not_become_active(bench: Bench) -> None:
    process = bench.start("controller", "autostart:=false")

    assert change(bench, Transition.TRANSITION_CONFIGURE)
    assert not change(bench, Transition.TRANSITION_ACTIVATE)
    bench.spin_until(lambda: "not activated: no joint state so far" in process.log.read_text(), "the reason")


def test_far_from_its_reference_it_does_not_become_active(bench: Bench) -> None:
    rig = Rig(bench, ("activation.distance:=0.1", "autostart:=false"), wait=False)
    assert change(bench, Transition.TRANSITION_CONFIGURE)
    rig.connect()
    rig.refer([0.4, -0.1])

    def refused() -> bool:
        rig.time += 0.001
        message = JointState(name=NAMES, position=START)
        set_stamp(message.header.stamp, round(rig.time * 1e9))
        rig.joint_states.publish(message)
        assert not change(bench, Transition.TRANSITION_ACTIVATE)
        return "joint1 is 0.2 rad from its reference (activation.distance 0.1)" in rig.process.log.read_text()

    bench.spin_until(refused, "the reason")


def test_its_last_torque_carries_the_arm(rig: Rig) -> None:
    rig.follow(START)
    rig.refer([0.4, -0.1])
    rig.step([0.2001, -0.1])
    count = len(rig.commands)
    rig.process.interrupt()
    rig.bench.spin_until(lambda: len(rig.commands) > count, "the last command")
    velocity = np.array(rig.states[-1].velocity)
    expected = np.clip(gravity([0.2001, -0.1]) - 20.0 * velocity, -LIMITS, LIMITS)
    np.testing.assert_allclose(rig.commands[-1].effort, expected, rtol=1e-6)
    assert rig.process.wait() == 0
    assert all(map(math.isfinite, rig.commands[-1].effort))
