"""What the middleware does for a sample that did not arrive, and for readers that come late."""

from functools import partial

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from support.testbed import Testbed

from pidtsm_ros.stamps import nanoseconds

SAMPLES = {"joint_states": 2, "reference": 1, "joint_commands": 1}
"""Topics of the loop, and how many of our nodes listen."""


@pytest.mark.parametrize(
    ("simulator", "controller", "trajectory", "expected"),
    [
        ("clock:=realtime", "reference.match:=latest", "clock:=realtime", ReliabilityPolicy.BEST_EFFORT),
        ("clock:=lockstep", "reference.match:=stamp", "clock:=lockstep", ReliabilityPolicy.RELIABLE),
    ],
)
def test_samples_are_asked_for_again_in_lockstep_alone(
    testbed: Testbed, simulator: str, controller: str, trajectory: str, expected: ReliabilityPolicy
) -> None:
    """In realtime a node that has not run for a moment would keep the loop sending what nobody needs any more."""
    testbed.start("simulator", simulator)
    testbed.start("controller", controller)
    testbed.start("trajectory", trajectory)

    def has_readers(topic: str, count: int) -> bool:
        return testbed.node.count_subscribers(topic) == count

    for topic, listening in {**SAMPLES, "joint_trajectory": 1}.items():
        testbed.spin_until(partial(has_readers, topic, listening), f"readers of {topic}")
        readers = testbed.node.get_subscriptions_info_by_topic(topic)
        wanted = expected if topic in SAMPLES else ReliabilityPolicy.RELIABLE
        assert {reader.qos_profile.reliability for reader in readers} == {wanted}, topic


def test_a_late_reader_gets_nothing_of_the_past(testbed: Testbed) -> None:
    """A few seconds of the loop, sent to everybody who joins, would hold the loop up."""
    early: list[JointState] = testbed.hear(JointState, "joint_states", QoSProfile(depth=1000))
    testbed.start("simulator", "start.subscribers:=0")
    testbed.spin_until(lambda: len(early) > 500, "500 samples")
    offered = testbed.node.get_publishers_info_by_topic("joint_states")
    assert [info.qos_profile.durability for info in offered] == [DurabilityPolicy.VOLATILE]
    newest = nanoseconds(early[-1].header.stamp)
    late: list[JointState] = testbed.hear(JointState, "joint_states", QoSProfile(depth=1000))
    testbed.spin_until(lambda: late, "a sample")
    assert nanoseconds(late[0].header.stamp) > newest
