"""The trajectory node answers joint states with references, and rejects trajectories that it cannot follow."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from control_msgs.msg import JointTrajectoryControllerState
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pidtsm_controller.trajectory_node import TrajectoryNode
from pidtsm_core.experiment.node_parameters import trajectory_node_schema
from pidtsm_core.parameters import resolve
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.references import ReferenceMotion
from pidtsm_msgs.msg import JointReference

NAMES = ["joint1", "joint2"]
MS = 1_000_000


@pytest.fixture
def answered(graph: Callable[..., Any]) -> tuple[Any, list[JointReference]]:
    """The active node, and the references that it published for joint states 1 ms apart."""
    made = graph(TrajectoryNode, "clock:=lockstep", "start.subscribers:=1")
    references: list[JointReference] = []
    made.stranger.create_subscription(JointReference, "reference", references.append, QoSProfile(depth=100))
    states = made.stranger.create_publisher(JointState, "joint_states", QoSProfile(depth=100))
    assert made.node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert made.node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: states.get_subscription_count() == 1, made.node.poll)
    for sample in range(5):
        message = JointState(name=NAMES, position=[0.0, 0.0])
        message.header.stamp.nanosec = sample * MS
        states.publish(message)
    made.until(lambda: len(references) == 5)
    return made, references


def test_every_joint_state_gets_the_reference_of_its_time(answered: tuple[Any, list[JointReference]]) -> None:
    motion = ReferenceMotion(resolve(trajectory_node_schema, {}, 2))
    expected = np.empty((3, 2))
    for sample, reference in enumerate(answered[1]):
        assert (reference.header.stamp.nanosec, reference.name) == (sample * MS, NAMES)
        motion.evaluate(sample * 1e-3, expected)
        got = [reference.position, reference.velocity, reference.acceleration]
        np.testing.assert_array_equal(got, expected)


def test_tools_read_its_state_as_that_of_a_trajectory_controller(graph: Callable[..., Any]) -> None:
    made = graph(TrajectoryNode, "clock:=lockstep", "start.subscribers:=1", "action_monitor_rate:=100.0")
    answers: list[JointReference] = []
    made.stranger.create_subscription(JointReference, "reference", answers.append, QoSProfile(depth=100))
    found: list[JointTrajectoryControllerState] = []
    made.stranger.create_subscription(
        JointTrajectoryControllerState, "trajectory/controller_state", found.append, QoSProfile(depth=100)
    )
    states = made.stranger.create_publisher(JointState, "joint_states", QoSProfile(depth=100))
    made.node.trigger_configure()
    made.node.trigger_activate()
    made.until(lambda: states.get_subscription_count() == 1, made.node.poll)
    sent = 0

    def send() -> None:
        """One joint state after the other, as in a loop: many at once do not fit the queue."""
        nonlocal sent
        if len(answers) == sent:
            message = JointState(name=NAMES[::-1], position=[-0.2, 0.3])
            message.header.stamp.nanosec = sent * MS
            states.publish(message)
            sent += 1

    made.until(lambda: len(found) >= 3, send)
    stamps = [state.header.stamp.nanosec for state in found]
    assert stamps[0] % (10 * MS) == 0
    assert set(np.diff(stamps)) == {10 * MS}
    for state in found:
        assert state.joint_names == NAMES
        assert list(state.feedback.positions) == [0.3, -0.2]
        error = np.subtract(state.reference.positions, state.feedback.positions)
        np.testing.assert_array_equal(state.error.positions, error)


def point(seconds: int, **fields: list[float]) -> JointTrajectoryPoint:
    made = JointTrajectoryPoint(**fields)
    made.time_from_start.sec = seconds
    return made


@pytest.mark.parametrize(
    ("names", "points", "reason"),
    [
        (["joint1", "elbow"], [point(1, positions=[0.0, 0.0])], "elbow"),
        (NAMES, [point(1, velocities=[0.0, 0.0])], "a point has velocities; it needs positions"),
        (NAMES, [point(1, positions=[0.0])], "position"),
        (NAMES, [point(2, positions=[0.0, 0.0]), point(1, positions=[0.1, 0.0])], "time"),
        (
            NAMES,
            [point(1, positions=[0.0, 0.0]), point(2, positions=[0.0, 0.0], velocities=[0.0, 0.0])],
            "point 2 has positions, velocities; the first has positions",
        ),
    ],
)
def test_a_trajectory_that_cannot_be_followed_is_rejected(
    answered: tuple[Any, list[JointReference]], names: list[str], points: list[JointTrajectoryPoint], reason: str
) -> None:
    made, _ = answered
    rejected = made.node.rejected
    publisher = made.stranger.create_publisher(JointTrajectory, "joint_trajectory", 10)
    made.until(lambda: publisher.get_subscription_count() == 1)
    message = JointTrajectory(joint_names=names, points=points)
    publisher.publish(message)
    made.until(lambda: made.node.rejected == rejected + 1)
    with pytest.raises(MessageError, match=reason):
        made.node._on_trajectory(message)
