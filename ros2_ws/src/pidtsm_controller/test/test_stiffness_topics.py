"""The controller node refuses a stiffness that nothing would use, and names what to set instead."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.lifecycle import TransitionCallbackReturn
from sensor_msgs.msg import JointState

from pidtsm_controller.controller_node import ControllerNode
from pidtsm_core.robots import find_robot
from pidtsm_msgs.msg import JointReference
from pidtsm_ros.stamps import set_stamp

ARM = "ur5"
START = np.array([0.0, -1.2, 1.8, -2.2, -1.57, 0.0])
JOINTS = list(find_robot({"robot.description": ARM}).joints)


@pytest.mark.parametrize(
    ("law", "cure"),
    [
        ("impedance", "the law has its own springs: set law.stiffness_x and the like as parameters"),
        ("piddtsm", "compliance.space is none: set it to tool"),
    ],
)
def test_a_stiffness_that_nothing_would_use_is_refused_with_the_cure(
    graph: Callable[..., Any], law: str, cure: str
) -> None:
    made = graph(ControllerNode, f"robot.description:={ARM}", "reference.match:=stamp", f"law.name:={law}")
    node = made.node
    reasons: list[str] = []
    node.reject = reasons.append
    states = made.stranger.create_publisher(JointState, "joint_states", 10)
    references = made.stranger.create_publisher(JointReference, "reference", 10)
    wrenches = made.stranger.create_publisher(WrenchStamped, "controller/set_cartesian_stiffness", 10)
    stamp = 0

    def send() -> None:
        nonlocal stamp
        stamp += 5_000_000
        rest = [0.0] * len(JOINTS)
        reference = JointReference(name=JOINTS, position=START.tolist(), velocity=rest, acceleration=rest)
        for publisher, message in ((references, reference), (states, JointState(name=JOINTS, position=START.tolist()))):
            set_stamp(message.header.stamp, stamp)
            publisher.publish(message)

    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: not node.refusal(), send)
    assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    made.until(lambda: any(cure in reason for reason in reasons), lambda: wrenches.publish(WrenchStamped()))
