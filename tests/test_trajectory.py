"""Trajectories on `joint_trajectory`, as MoveIt and rqt send them."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from support.testbed import Testbed
from support.trajectory_rig import NAMES, PERMUTED, PRACTICAL, Rig, point, sine, trajectory
from trajectory_msgs.msg import JointTrajectory

from pidtsm_msgs.msg import JointReference
from pidtsm_ros.stamps import nanoseconds


def by_time(messages: list[Any]) -> NDArray[np.float64]:
    """Time in s and positions, shape (messages, 3)."""
    assert all(list(message.name) == NAMES for message in messages)
    return np.array([[nanoseconds(m.header.stamp) / 1e9, *m.position] for m in messages])


def test_a_quintic_from_point_to_point_is_followed(testbed: Testbed) -> None:
    node, every = testbed.node, QoSProfile(depth=10_000)
    truth: list[JointState] = testbed.hear(JointState, "simulator/ground_truth", every)
    references: list[JointReference] = testbed.hear(JointReference, "reference", every)
    publisher = node.create_publisher(JointTrajectory, "joint_trajectory", 10)
    simulator = testbed.start("simulator", "clock:=lockstep", "duration:=5.0", "start.subscribers:=3")
    # The article's disturbance acts. With the article's own gains joint2 is worse, see docs/trajectories.md.
    arguments = ["--params-file", str(PRACTICAL), "-p", "reference.match:=stamp"]
    testbed.processes.start("controller", arguments, testbed.environment, testbed.folder / "controller.log")
    process = testbed.start("trajectory", "clock:=lockstep", "start.subscribers:=2")
    testbed.spin_until(publisher.get_subscription_count, "the trajectory node")
    # The third subscriber: the run begins.
    node.create_subscription(JointState, "joint_states", lambda message: None, 10)
    testbed.spin_until(lambda: references, "the first reference")

    publisher.publish(trajectory(point(3.0, [-0.5, 0.6], [0.0, 0.0], [0.0, 0.0]), names=PERMUTED, start=1.0))
    testbed.spin_until(lambda: simulator.process.poll() is not None, "the end of the run")
    testbed.spin_until(lambda: len(truth) == 5000 and len(references) == 5000, "all samples")

    assert simulator.process.returncode == 0, simulator.tail()
    assert "following a trajectory of 1 points" in process.log.read_text()
    actual, wanted = by_time(truth), by_time(references)
    np.testing.assert_array_equal(actual[:, 0], wanted[:, 0])
    np.testing.assert_allclose(wanted[4000:, 1:], np.broadcast_to([0.6, -0.5], (1000, 2)), rtol=1e-12)
    assert np.abs(np.diff(wanted[:, 1:], n=2, axis=0)).max() < 2e-6, "the reference has no corner"
    error = (actual - wanted)[2000:, 1:]
    assert np.sqrt(np.mean(error**2, axis=0)).max() < 1e-3


@pytest.fixture
def rig(testbed: Testbed) -> Rig:
    return Rig(testbed)


GOOD = point(1.0, [0.1, 0.2])
NAN = math.nan
REFUSED = [
    (trajectory(GOOD, names=["joint1"]), "joints joint2 are missing"),
    (trajectory(GOOD, names=["joint1", "joint3"]), "unknown joints joint3, missing joint2"),
    (trajectory(GOOD, names=["joint1", "joint2", "joint2"]), "a joint is named twice"),
    (trajectory(point(1.0, [0.1])), "positions of point 1 has 1 values for 2 joints"),
    (trajectory(point(1.0, [0.1, 0.2], [0.0])), "velocities of point 1 has 1 values for 2 joints"),
    (trajectory(GOOD, point(2.0, [0.1, NAN])), "positions of point 2 is not finite"),
    (
        trajectory(GOOD, point(2.0, [0.1, 0.2], [0.0, 0.0])),
        "point 2 has positions, velocities; the first has positions",
    ),
    (trajectory(point(1.0)), "a point has nothing"),
    (trajectory(point(1.0, [0.1, 0.2], [], [0.0, 0.0])), "a point has positions, accelerations"),
    (trajectory(GOOD, GOOD), "increase from point to point"),
    (trajectory(GOOD, start=8.0), "it is over: it started 2 s ago"),
    (trajectory(point(0.0, [0.5, 0.5]), GOOD), "point 1 is due now, and"),
    (trajectory(point(1.0, [0.1, 0.2], [0.1, 0.0])), "it must end at rest"),
]


def test_what_cannot_be_followed_is_refused_with_the_reason_and_the_motion_goes_on(rig: Rig) -> None:
    rig.send(trajectory(GOOD), "rejected joint_trajectory: no joint state received yet")
    rig.at(7.5)
    rig.at(10.0)
    for message, reason in REFUSED:
        rig.send(message, reason)
    assert rig.process.log.read_text().count("rejected joint_trajectory") == len(REFUSED) + 1
    np.testing.assert_allclose(rig.at(11.0), sine(3.5), atol=1e-12)


def test_it_is_preempted_smoothly_and_cancelled_smoothly(rig: Rig) -> None:
    rig.at(10.0)
    rest = [0.0, 0.0]
    rig.send(trajectory(point(2.0, [0.5, -0.5], rest, rest), names=PERMUTED), "following a trajectory")
    np.testing.assert_allclose(rig.at(10.0), sine(0.0), atol=1e-12)
    present = rig.at(11.0)
    rig.send(trajectory(point(1.0, [0.0, 0.1], rest, rest)), "following a trajectory")
    np.testing.assert_allclose(rig.at(11.0), present, atol=1e-12)
    present = rig.at(11.5)
    rig.send(JointTrajectory(), "cancelled: coming to rest")
    np.testing.assert_allclose(rig.at(11.5), present, atol=1e-12)
    held = rig.at(12.0)
    assert not held[1:].any()
    np.testing.assert_array_equal(rig.at(20.0), held)


def test_a_stamp_that_goes_back_moves_nothing(rig: Rig) -> None:
    rig.at(10.0)
    rig.send(trajectory(point(1.0, [0.1, 0.2])), "following a trajectory")
    held = rig.at(12.0)
    for k, late in enumerate((0.003, 0.9, 5.0, 3600.0)):
        rig.publish(12.0 - late)
        np.testing.assert_array_equal(rig.at(12.1 + k), held)
    text = "rejected joint_states: late: the stamp is older than"
    assert rig.process.log.read_text().count(text) == 1, "once per cause"


@pytest.mark.parametrize("arm", [[0.3, -0.2], [0.7, 0.1]], ids=["as before", "elsewhere"])
def test_where_the_clock_has_been_set_the_arm_is_held_until_the_motion_is_begun(rig: Rig, arm: list[float]) -> None:
    rig.at(10.0)
    rig.send(trajectory(point(1.0, [-0.2, 0.3])), "following a trajectory")
    present = rig.at(12.0)
    rig.arm = arm
    rig.publish(5.0)
    held = rig.at(5.0)
    np.testing.assert_allclose(held, [arm[::-1], [0.0, 0.0], [0.0, 0.0]], atol=1e-12)
    np.testing.assert_array_equal(rig.at(9.0), held)
    assert (held == present).all() == (arm == [0.3, -0.2])
    assert "call ~/begin to start the built-in motion" in rig.process.log.read_text()

    assert rig.testbed.call(Trigger, "trajectory/begin", Trigger.Request()).success
    np.testing.assert_allclose(rig.at(9.0), held, atol=1e-12)
    path = np.array([rig.at(9.0 + 0.05 * k)[0] for k in range(1, 80)])
    assert np.abs(np.diff(path, axis=0)).max() < 0.1
    np.testing.assert_allclose(rig.at(14.0), sine(5.0), atol=1e-12)


@pytest.mark.parametrize("service", ["begin", "go_to_arm"])
def test_nothing_is_begun_before_there_is_a_joint_state(rig: Rig, service: str) -> None:
    response = rig.testbed.call(Trigger, f"trajectory/{service}", Trigger.Request())
    assert not response.success
    assert "no joint state" in response.message


def test_the_reference_can_be_brought_to_an_arm_that_is_elsewhere(rig: Rig) -> None:
    rig.at(10.0)
    rig.arm = [2.0, -3.0]
    present = rig.at(11.0)
    assert rig.testbed.call(Trigger, "trajectory/go_to_arm", Trigger.Request()).success
    np.testing.assert_allclose(rig.at(11.0), present, atol=1e-12)
    path = np.array([rig.at(11.0 + 0.1 * k) for k in range(1, 100)])
    assert np.abs(np.diff(path[:, 0], axis=0)).max() < 0.15, "no step"
    np.testing.assert_allclose(path[-1], [rig.arm[::-1], [0.0, 0.0], [0.0, 0.0]], atol=1e-12)


def test_large_trajectories_are_planned_outside_the_loop_and_the_newest_counts(rig: Rig) -> None:
    """Each joint state is answered meanwhile; the motion begins without a step, from a reference that moves."""
    path = [rig.at(1.0)]
    assert path[0][1:].any(), "the built-in motion moves"
    log, samples = rig.process.log, 0
    for last, duration in ((0.1, 18.0), (0.2, 19.0), (0.3, 20.0)):
        rig.trajectories.publish(sampled(last, duration))
    replaced = "a trajectory is replaced by a newer trajectory before it was planned"
    rig.testbed.spin_until(lambda: replaced in log.read_text(), "the newer trajectories")
    while "following a trajectory of 5000 points, 20 s" not in log.read_text():
        samples += 1
        assert samples < 1000
        path.append(rig.at(1.0 + 1e-3 * samples))
    begin = 1.0 + 1e-3 * samples
    path += [rig.at(begin + 1e-3 * k) for k in range(1, 100)]
    assert np.abs(np.diff([state[0] for state in path], n=2, axis=0)).max() < 5e-6, "the reference has no corner"
    np.testing.assert_allclose(rig.at(begin + 25.0)[0], [0.3, 0.0], atol=1e-9)


def test_what_is_wrong_with_a_large_trajectory_is_logged(rig: Rig) -> None:
    rig.at(1.0)
    broken = sampled(0.1)
    broken.points[4000].positions[1] = NAN
    rig.trajectories.publish(broken)
    samples = 0
    while "positions of point 4001 is not finite: joint2" not in rig.process.log.read_text():
        samples += 1
        assert samples < 1000
        rig.at(1.0 + 1e-3 * samples)


def sampled(last: float, duration: float = 20.0) -> JointTrajectory:
    """5,000 points of a quintic to this position of the first joint, from rest."""
    points = []
    for k in range(1, 5001):
        x = k / 5000
        q = last * x**3 * (10.0 - x * (15.0 - 6.0 * x))
        dq = last * x**2 * (30.0 - x * (60.0 - 30.0 * x)) / duration
        ddq = last * x * (60.0 - x * (180.0 - 120.0 * x)) / duration**2
        points.append(point(duration * x, [q, 0.0], [dq, 0.0], [ddq, 0.0]))
    return trajectory(*points, start=3.0)
