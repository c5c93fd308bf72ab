"""The visualization node turns what the loop says into what viewers show."""

import importlib.util
from typing import Any

import pytest
from bench import Bench
from builtin_interfaces.msg import Time
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from visualization_msgs.msg import MarkerArray

from pidtsm_msgs.msg import JointReference

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def hear(bench: Bench, message_type: Any, topic: str, qos: QoSProfile | int = 10) -> list[Any]:
    heard: list[Any] = []
    bench.node.create_subscription(message_type, topic, heard.append, qos)
    return heard


class Loop:
    """A stranger that says what simulator, trajectory and controller say, joints in another order."""

    def __init__(self, bench: Bench) -> None:
        create = bench.node.create_publisher
        self.states = create(JointState, "joint_states", 10)
        self.commands = create(JointState, "joint_commands", 10)
        self.references = create(JointReference, "reference", 10)

    def say(self) -> None:
        header, name = Header(stamp=Time(sec=7)), ["joint2", "joint1"]
        self.states.publish(JointState(header=header, name=name, position=[0.5, 0.2]))
        self.commands.publish(JointState(header=header, name=name, effort=[50.0, -25.0]))
        self.references.publish(JointReference(header=header, name=name, position=[0.4, float("nan")]))


def test_description_and_torques_are_shown(bench: Bench) -> None:
    bench.start("visualization")
    descriptions = hear(bench, String, "robot_description", LATCHED)
    markers = hear(bench, MarkerArray, "visualization/markers")
    loop = Loop(bench)

    def both_torques() -> bool:
        loop.say()
        return any(len(array.markers) == 2 for array in markers)

    bench.spin_until(lambda: descriptions, "a robot description")
    assert '<robot name="two_link">' in descriptions[0].data
    bench.spin_until(both_torques, "markers of both joints")
    first, second = next(array.markers for array in markers if len(array.markers) == 2)
    assert (first.color.r, second.color.r) == (0.25, 1.0)
    assert first.header.stamp.sec == 7


@pytest.mark.skipif(importlib.util.find_spec("tf2_msgs") is None, reason="tf2_msgs is not installed: no wheel has it")
def test_arm_and_reference_have_frames(bench: Bench) -> None:
    from tf2_msgs.msg import TFMessage

    bench.start("visualization")
    heard = hear(bench, TFMessage, "tf")
    loop = Loop(bench)

    def frames() -> dict[str, Any]:
        loop.say()
        return {frame.child_frame_id: frame for message in heard for frame in message.transforms}

    bench.spin_until(lambda: len(frames()) == 5, "frames of the arm and of the reference")
    found = frames()
    assert found["link1"].transform.rotation.y == pytest.approx(-0.0998334)
    assert found["reference/link2"].transform.rotation.y == pytest.approx(-0.1986693)
    assert found["reference/link1"].transform.rotation.w == 1.0, "a value that is not finite is left out"


def test_a_description_that_cannot_be_shown_is_refused(bench: Bench) -> None:
    process = bench.start("visualization", "robot_description:='<robot/>'")
    bench.spin_until(lambda: process.process.poll() is not None, "the end of the node")
    assert process.process.returncode == 2
    assert "cannot start: the robot description must have joints" in process.tail()
    assert "Traceback" not in process.tail()
