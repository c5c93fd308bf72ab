"""Streams of targets on the real nodes: a loop in lockstep, and a trajectory node whose time the test decides."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from control_msgs.msg import JointJog
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from support.testbed import Testbed, open_testbed
from support.trajectory_rig import NAMES, PERMUTED, PRACTICAL, Rig, point, sine, trajectory
from trajectory_msgs.msg import JointTrajectory

from pidtsm_msgs.msg import JointReference
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.stamps import nanoseconds, set_stamp

Vector = NDArray[np.float64]
LIMITS = {"limits.velocity": 2.0, "limits.acceleration": 5.0, "limits.jerk": 100.0}
MS = 1_000_000


def hand(t: Any) -> Vector:
    """A motion like that of a hand, up to 0.6 rad/s and 1.7 rad/s^2, shape (times, 2), rad."""
    w, a = 2.0 * math.pi * np.array([0.25, 0.6, 1.1]), np.array([0.25, 0.05, 0.008])
    return np.stack([np.sin(np.multiply.outer(t, w) + phase) @ a for phase in (0.0, 1.0)], axis=-1)


def target(position: Any, stamp: float, names: list[str] = NAMES, **others: Any) -> JointState:
    message = JointState(name=names, position=list(position), **others)
    set_stamp(message.header.stamp, round(stamp * 1e9))
    return message


def sent_by_a_hand(begin: float, end: float) -> list[tuple[float, JointState]]:
    """Messages of a 30 Hz stream with their times of arrival, s: up to 20 ms late, 5 % missing."""
    rng, messages = np.random.default_rng(19), []
    for k in range(int((end - begin) * 30.0)):
        t = begin + k / 30.0
        if rng.random() >= 0.05:
            messages.append((t + rng.uniform(0.0, 0.02), target(hand(t)[::-1], t, PERMUTED)))
    return messages


def sampled(messages: list[Any], *fields: str) -> Vector:
    """Time in s and the fields, shape (messages, 1 + 2 fields)."""
    times = [[nanoseconds(message.header.stamp) / 1e9] for message in messages]
    return np.hstack([times, *([list(getattr(message, field)) for message in messages] for field in fields)])


def test_the_arm_follows_a_hand_and_rests_when_the_stream_stops(testbed: Testbed) -> None:
    """The test passes the joint states on, and sends each target before the joint state at which it arrives."""
    node, every = testbed.node, QoSProfile(depth=10_000)
    truth: list[JointState] = testbed.hear(JointState, "simulator/ground_truth", every)
    references: list[JointReference] = testbed.hear(JointReference, "reference", every)
    targets = node.create_publisher(JointState, "trajectory/joint_target", 10)
    states = node.create_publisher(JointState, "joint_states", 100)
    waiting = sent_by_a_hand(0.3, 3.2)
    last = waiting[-1][0]

    def pass_on(state: bytes) -> None:
        while waiting and waiting[0][0] * 1e9 <= serialized_nanoseconds(state):
            targets.publish(waiting.pop(0)[1])
        states.publish(state)

    arguments = ["--params-file", str(PRACTICAL), "-p", "reference.match:=stamp"]
    testbed.processes.start("controller", arguments, testbed.environment, testbed.folder / "controller.log")
    limits = [f"{name}:={value}" for name, value in LIMITS.items()]
    testbed.start("trajectory", "clock:=lockstep", "start.subscribers:=2", *limits)
    testbed.spin_until(lambda: targets.get_subscription_count() and states.get_subscription_count() == 2, "the nodes")
    arguments = ["-r", "joint_states:=arm/joint_states", "-p", "clock:=lockstep", "-p", "duration:=4.0"]
    simulator = testbed.processes.start(
        "simulator", [*arguments, "-p", "start.subscribers:=1"], testbed.environment, testbed.folder / "simulator.log"
    )
    node.create_subscription(JointState, "arm/joint_states", pass_on, every, raw=True)
    testbed.spin_until(lambda: simulator.process.poll() is not None, "the end of the run")
    testbed.spin_until(lambda: len(truth) == 4000 and len(references) >= 4000, "all samples")
    assert simulator.process.returncode == 0, simulator.tail()

    wanted = sampled(references[:4000], "position", "velocity", "acceleration")
    actual = sampled(truth, "position")
    np.testing.assert_array_equal(actual[:, 0], wanted[:, 0])
    following = wanted[400:]
    assert np.abs(np.diff(following[:, 5:], axis=0)).max() <= 1e-3 * LIMITS["limits.jerk"] + 1e-9
    assert np.abs(following[:, 5:]).max() <= LIMITS["limits.acceleration"]
    span = slice(2000, 3150)
    delays = np.arange(0.0, 0.1, 1e-3)
    errors = [np.mean((wanted[span, 1:3] - hand(wanted[span, 0] - d)) ** 2) for d in delays]
    assert delays[np.argmin(errors)] <= 0.06
    assert math.sqrt(min(errors)) < 4e-3
    assert np.abs(actual[span, 1:] - wanted[span, 1:3]).max() <= 2e-3
    rest = round((last + 0.3) * 1e3) + 1
    assert not wanted[rest:, 3:].any()
    assert np.abs(actual[rest:, 1:] - wanted[rest:, 1:3]).max() <= 2e-3


class StreamRig(Rig):
    """A trajectory node that is sent targets."""

    def __post_init__(self) -> None:
        node = self.testbed.node
        self.targets = node.create_publisher(JointState, "trajectory/joint_target", 10)
        self.chunks = node.create_publisher(JointTrajectory, "trajectory/joint_target_trajectory", 10)
        self.arrays = node.create_publisher(Float64MultiArray, "trajectory/joint_target_array", 10)
        self.jogs = node.create_publisher(JointJog, "trajectory/joint_jog", 10)
        self.reports: list[DiagnosticArray] = []
        node.create_subscription(DiagnosticArray, "/diagnostics", self.reports.append, 10)
        super().__post_init__()
        publishers = (self.targets, self.chunks, self.arrays, self.jogs)
        self.testbed.spin_until(lambda: all(p.get_subscription_count() for p in publishers), "the topics")
        self.t = 10.0
        self.at(self.t)

    def publish_target(self, message: Any) -> None:
        """Send a target, a chunk or a jog; it arrives before the next joint state."""
        topics = {JointTrajectory: self.chunks, Float64MultiArray: self.arrays, JointJog: self.jogs}
        topics.get(type(message), self.targets).publish(message)

    def stream(self, seconds: float, velocity: float = 0.1, begin: float = 0.0) -> Vector:
        """References at every 4 ms, shape (samples, 3, joints), while a 50 Hz stream moves on from `begin`, rad."""
        samples = []
        for k in range(round(seconds / 0.004)):
            if k % 5 == 0:
                self.publish_target(target([begin + 0.004 * k * velocity] * 2, self.t))
            samples.append(self.go_on())
        return np.array(samples)

    def go_on(self, seconds: float = 0.004) -> Vector:
        """The reference after a time in which nothing is sent."""
        for _ in range(round(seconds / 0.004)):
            self.t += 0.004
            reference = self.at(self.t)
        return reference

    def log(self) -> str:
        return self.process.log.read_text()


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StreamRig]:
    with open_testbed(tmp_path_factory.mktemp("streams")) as testbed:
        yield StreamRig(testbed)


@pytest.fixture
def rig(shared: StreamRig) -> StreamRig:
    """The shared rig, when no stream has come for long, and the reference rests at 0."""
    shared.go_on(1.0)
    shared.send(trajectory(point(1.0, [0.0, 0.0], [0.0, 0.0], [0.0, 0.0])), "following a trajectory")
    shared.go_on(1.2)
    return shared


def check_smooth(samples: Vector) -> None:
    """No step of position or velocity: the default limits are 5 rad/s^2 and 50 rad/s^3."""
    assert np.abs(samples[:, 2]).max() <= 5.0 + 1e-9
    np.testing.assert_allclose(np.diff(samples[:, 0], axis=0), 0.004 * samples[1:, 1], atol=1e-4)
    np.testing.assert_allclose(np.diff(samples[:, 1], axis=0), 0.004 * samples[1:, 2], atol=1e-3)


def test_a_stream_takes_over_from_a_motion_without_a_step_and_rests_when_it_stops(shared: StreamRig) -> None:
    t0 = shared.t - 10.0
    np.testing.assert_allclose(shared.at(shared.t), sine(t0), atol=1e-12)
    before = shared.go_on()
    samples = shared.stream(1.5)
    check_smooth(np.concatenate([[before], samples]))
    np.testing.assert_allclose(samples[-1], [[0.15, 0.15], [0.1, 0.1], [0.0, 0.0]], atol=0.02)
    after = np.array([shared.go_on() for _ in range(100)])
    check_smooth(np.concatenate([samples[-1:], after]))
    assert not after[75:, 1:].any()
    assert "the stream of targets has stopped: coming to rest" in shared.log()


def test_a_stream_is_named_in_the_diagnostics(rig: StreamRig) -> None:
    rig.stream(0.5)
    rig.go_on(0.4)
    rig.reports.clear()

    def stopped() -> bool:
        return any("the stream of targets has stopped" in report.status[0].message for report in rig.reports)

    rig.testbed.spin_until(stopped, "the diagnostics")
    values = {pair.key: float(pair.value) for pair in rig.reports[-1].status[0].values}
    assert values["stream: rate (1/s)"] == pytest.approx(50.0, rel=0.1)
    assert values["stream: age of the last target (s)"] == pytest.approx(0.42, abs=0.01)
    assert {"stream: delay of the reference (s)", "stream: targets missing"} <= set(values)


def test_a_trajectory_takes_over_from_a_stream_until_that_has_paused(rig: StreamRig) -> None:
    before = rig.stream(0.6)
    rig.send(trajectory(point(0.6, [0.3, 0.3], [0.0, 0.0], [0.0, 0.0])), "following a trajectory")
    after = rig.stream(0.8, begin=-1.0)
    check_smooth(np.concatenate([before[-1:], after[:1]]))
    np.testing.assert_allclose(after[-1], [[0.3, 0.3], [0.0, 0.0], [0.0, 0.0]], atol=1e-6)
    assert "another motion has taken over; the stream is followed again after a pause of 0.5 s" in rig.log()
    rig.go_on(0.6)
    assert np.abs(rig.stream(0.8, begin=0.2)[-1, 0] - 0.28).max() < 0.02


def test_joints_that_are_not_named_hold(rig: StreamRig) -> None:
    for _ in range(20):
        rig.publish_target(target([0.1], rig.t, ["joint2"]))
        reference = rig.go_on(0.02)
    assert reference[0, 0] == pytest.approx(0.0, abs=1e-6)
    assert reference[0, 1] == pytest.approx(0.1, abs=0.01)


def test_overlapping_chunks_are_followed_smoothly(rig: StreamRig) -> None:
    samples = []
    for k in range(8):
        begin, offset = 0.3 * k, 0.005 * (-1.0) ** k
        way = [point(i / 30.0, [0.1 * (begin + i / 30.0) + offset] * 2) for i in range(30)]
        rig.publish_target(trajectory(*way, start=rig.t - 0.04))
        samples += [rig.go_on() for _ in range(75)]
    check_smooth(np.array(samples))
    assert np.abs(samples[-1][0] - 0.1 * 2.44).max() < 0.02
    assert not rig.go_on(1.0)[1:].any()


NAN = math.nan
BAD = [
    (target([NAN, 0.0], 0.0), "position is not finite"),
    (target([0.0, 0.0], 0.0, velocity=[0.0, math.inf]), "velocity is not finite"),
    (target([0.0], 0.0), "position has 1 values for 2 joints"),
    (target([0.0, 0.0], 0.0, velocity=[0.0]), "velocity has 1 values for 2 joints"),
    (target([0.0, 0.0], 0.0, ["joint1", "joint3"]), "unknown joints joint3"),
    (target([0.0, 0.0], 0.0, ["joint1", "joint1"]), "named"),
    (target([], 0.0, []), "named once"),
    (target([0.0, 0.0], 3.0), "late: the stamp is older"),
    (target([0.0, 0.0], 1e6), "ahead: the stamp is ahead"),
    (trajectory(), "it has no points"),
    (trajectory(point(1.0, [0.0, NAN])), "positions of point 1 is not finite"),
    (trajectory(point(1.0, [0.0, 0.0]), point(1.0, [0.0, 0.0])), "increase from point to point"),
    (trajectory(point(1.0, [0.0, 0.0]), start=3.0), "it is over"),
    (trajectory(*[point(0.001 * k, [0.0, 0.0]) for k in range(1001)]), "1001 points"),
]


def test_what_cannot_be_used_is_rejected_with_the_reason_and_the_stream_goes_on(rig: StreamRig) -> None:
    rig.stream(0.4)
    samples = []
    for k, (message, reason) in enumerate(BAD):
        before = rig.log().count(reason)
        rig.publish_target(message)
        rig.publish_target(target([0.1 * (0.4 + 0.02 * k)] * 2, rig.t))
        samples += [rig.go_on() for _ in range(5)]

        def rejected(reason: str = reason, before: int = before) -> bool:
            return rig.log().count(reason) > before

        rig.testbed.spin_until(rejected, reason)
    check_smooth(np.array(samples))
    assert np.abs(np.array(samples)[:, 1] - 0.1).max() < 0.03


def test_nothing_is_followed_before_there_is_a_joint_state(testbed: Testbed) -> None:
    process = testbed.start("trajectory", "clock:=lockstep")
    targets = testbed.node.create_publisher(JointState, "trajectory/joint_target", 10)
    testbed.spin_until(targets.get_subscription_count, "the trajectory node")
    targets.publish(target([0.0, 0.0], 1.0))
    testbed.spin_until(lambda: "no joint state received yet" in process.log.read_text(), "the reason")


SERVO = 0.012
"""Publish period of MoveIt Servo, s; its messages are those of its published sources."""


def one_point(rig: StreamRig, k: int, velocity: float) -> JointTrajectory:
    """Up to Iron: a point without a stamp, one period ahead."""
    return trajectory(point(SERVO, [velocity * SERVO * (k + 1)] * 2, [velocity] * 2))


def window(rig: StreamRig, k: int, velocity: float) -> JointTrajectory:
    """From Jazzy on: what was sent in the last 0.1 s, and reaches 0.1 s ahead, less the newest point."""
    steps = range(max(k - 20, 0), k + 2)
    way = [point(SERVO * (i - steps[0]), [velocity * SERVO * i] * 2, [velocity] * 2) for i in steps]
    return trajectory(*way, start=rig.t + SERVO * (steps[0] - k) + 0.1)


def no_velocities(rig: StreamRig, k: int, velocity: float) -> JointTrajectory:
    """With publish_joint_velocities: false."""
    return trajectory(point(SERVO, [velocity * SERVO * (k + 1)] * 2))


def array(rig: StreamRig, k: int, velocity: float) -> Float64MultiArray:
    """With command_out_type: std_msgs/Float64MultiArray."""
    return Float64MultiArray(data=[velocity * SERVO * (k + 1)] * 2)


def jog(rig: StreamRig, k: int, velocity: float) -> JointJog:
    """What Servo itself receives."""
    message = JointJog(joint_names=["joint2", "joint1"], velocities=[velocity] * 2)
    set_stamp(message.header.stamp, round(rig.t * 1e9))
    return message


@pytest.mark.parametrize("form", [one_point, window, no_velocities, array, jog])
def test_what_moveit_servo_sends_is_followed(rig: StreamRig, form: Callable[..., Any]) -> None:
    samples = []
    for k in range(100):
        rig.publish_target(form(rig, k, 0.1))
        samples += [rig.go_on() for _ in range(3)]
    moving = np.array(samples)
    np.testing.assert_allclose(moving[-40:, 1], 0.1, atol=0.01)
    np.testing.assert_allclose(moving[-1, 0], 0.12, atol=0.015)
    assert np.abs(moving[:, 2]).max() <= 5.0 + 1e-9
    rest = rig.go_on(1.0)
    assert not rest[1:].any()
    np.testing.assert_allclose(rest[0], 0.12, atol=0.04)


SERVO_REFUSED = [
    (trajectory(point(SERVO, [], [0.1, 0.1])), "it needs positions"),
    (Float64MultiArray(data=[0.1, -0.2]), "send positions, not velocities, in the order joint1, joint2"),
    (Float64MultiArray(data=[0.1]), "data has 1 values for 2 joints"),
    (Float64MultiArray(data=[0.1, NAN]), "data is not finite"),
    (JointJog(joint_names=["joint1"], displacements=[0.1]), "displacements are not followed; send velocities"),
    (JointJog(joint_names=["joint1"], velocities=[0.1, 0.1]), "velocities has 2 values for 1 joints"),
    (JointJog(joint_names=["joint1"], velocities=[math.inf]), "velocities is not finite"),
    (trajectory(point(0.1, [0.0, 0.0]), point(0.2, [0.0, 0.0]), start=1.7e9), "use_sim_time"),
    (trajectory(point(0.1, [0.0, 0.0]), point(0.2, [0.0, 0.0]), start=0.5), "use_sim_time"),
]


@pytest.mark.parametrize(("message", "cure"), SERVO_REFUSED)
def test_what_moveit_servo_should_send_otherwise_is_refused_with_the_cure(
    rig: StreamRig, message: Any, cure: str
) -> None:
    before = rig.log().count(cure)
    rig.publish_target(message)
    rig.testbed.spin_until(lambda: rig.log().count(cure) > before, cure)
    assert not rig.go_on(0.1)[1:].any()


def test_servo_on_the_topic_of_whole_trajectories_is_sent_to_that_of_streams(rig: StreamRig) -> None:
    rig.send(one_point(rig, 0, 0.1), "a stream goes to ~/joint_target_trajectory")


def test_another_target_ends_a_jog(rig: StreamRig) -> None:
    for k in range(20):
        rig.publish_target(jog(rig, k, 0.3))
        rig.go_on(0.012)
    for _ in range(40):
        rig.publish_target(target([0.0, 0.0], rig.t))
        reference = rig.go_on(0.012)
    assert np.abs(reference[0]).max() < 0.01


def test_a_target_that_is_rejected_does_not_end_a_jog(rig: StreamRig) -> None:
    for k in range(30):
        rig.publish_target(jog(rig, k, 0.1))
        rig.publish_target(target([NAN, 0.0], rig.t))
        reference = rig.go_on(0.012)
    np.testing.assert_allclose(reference[1], 0.1, atol=0.01)
