"""The visualization node turns what the loop says into what viewers show."""

import importlib.util
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from testbed import Testbed
from visualization_msgs.msg import MarkerArray

from pidtsm_msgs.msg import JointReference

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def hear(testbed: Testbed, message_type: Any, topic: str, qos: QoSProfile | int = 10) -> list[Any]:
    heard: list[Any] = []
    testbed.node.create_subscription(message_type, topic, heard.append, qos)
    return heard


class Loop:
    """A stranger that says what simulator, trajectory and controller say, joints in another order."""

    def __init__(self, testbed: Testbed) -> None:
        create = testbed.node.create_publisher
        self.states = create(JointState, "joint_states", 10)
        self.commands = create(JointState, "joint_commands", 10)
        self.references = create(JointReference, "reference", 10)

    def say(self) -> None:
        header, name = Header(stamp=Time(sec=7)), ["joint2", "joint1"]
        self.states.publish(JointState(header=header, name=name, position=[0.5, 0.2]))
        self.commands.publish(JointState(header=header, name=name, effort=[50.0, -25.0]))
        self.references.publish(JointReference(header=header, name=name, position=[0.4, float("nan")]))


def test_description_and_torques_are_shown(testbed: Testbed) -> None:
    testbed.start("visualization")
    descriptions = hear(testbed, String, "robot_description", LATCHED)
    markers = hear(testbed, MarkerArray, "visualization/markers")
    loop = Loop(testbed)

    def both_torques() -> bool:
        loop.say()
        return any(len(array.markers) == 2 for array in markers)

    testbed.spin_until(lambda: descriptions, "a robot description")
    assert '<robot name="two_link">' in descriptions[0].data
    testbed.spin_until(both_torques, "markers of both joints")
    first, second = next(array.markers for array in markers if len(array.markers) == 2)
    assert (first.color.r, second.color.r) == (0.25, 1.0)
    assert first.header.stamp.sec == 7


@pytest.mark.skipif(importlib.util.find_spec("tf2_msgs") is None, reason="tf2_msgs is not installed: no wheel has it")
def test_arm_and_reference_have_frames(testbed: Testbed) -> None:
    from tf2_msgs.msg import TFMessage

    testbed.start("visualization")
    heard = hear(testbed, TFMessage, "tf")
    loop = Loop(testbed)

    def frames() -> dict[str, Any]:
        loop.say()
        return {frame.child_frame_id: frame for message in heard for frame in message.transforms}

    testbed.spin_until(lambda: len(frames()) == 5, "frames of the arm and of the reference")
    found = frames()
    assert found["link1"].transform.rotation.y == pytest.approx(-0.0998334)
    assert found["reference/link2"].transform.rotation.y == pytest.approx(-0.1986693)
    assert found["reference/link1"].transform.rotation.w == 1.0, "a value that is not finite is left out"


def test_a_description_that_cannot_be_shown_is_refused(testbed: Testbed) -> None:
    process = testbed.start("visualization", "robot_description:='<robot/>'")
    testbed.spin_until(lambda: process.process.poll() is not None, "the end of the node")
    assert process.process.returncode == 2
    assert "cannot start: the robot description must have joints" in process.tail()
    assert "Traceback" not in process.tail()
