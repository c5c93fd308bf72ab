"""Messages become bytes of exactly their length, which rclpy reads as the same message."""

import os
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import InertiaStamped, WrenchStamped
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from rosidl_parser.definition import UnboundedWString
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import Bool, Empty, Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker

from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.serialization import serialize, serialize_checked

JOINTS = ["shoulder", "elbow", "jointé"]
POINT = JointTrajectoryPoint(positions=[1.0, 2.0], effort=[0.5], time_from_start=Duration(sec=1, nanosec=5))
STATUS = DiagnosticStatus(level=b"\x02", name="a", message="text", values=[KeyValue(key="k", value="")])
MESSAGES = [
    JointState(),
    *(JointState(name=JOINTS[:count], position=[1.0] * count, effort=[2.0] * count) for count in (1, 2, 3)),
    JointState(name=JOINTS, effort=[1.0, 2.0, 3.0]),
    JointState(name=JOINTS, position=[1.0, 2.0, 3.0], velocity=[-0.0, 1e300, 5e-324]),
    JointReference(name=JOINTS, acceleration=[1.0, 2.0, 3.0]),
    ControllerState(name=JOINTS, mode=2, compute_time=1e-4),
    Float64MultiArray(data=[1.0, 2.0]),
    Float64MultiArray(),
    Clock(),
    Empty(),
    Bool(data=True),
    String(data="frame"),
    DiagnosticArray(status=[STATUS, DiagnosticStatus(), STATUS]),
    WrenchStamped(),
    InertiaStamped(),
    JointTrajectory(joint_names=JOINTS, points=[POINT, JointTrajectoryPoint(), POINT]),
    Marker(ns="arm", scale=Marker().scale, text="t", mesh_resource="m"),
    Image(data=[1, 2, 255], width=3),
]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_rclpy_reads_the_same_message_and_nothing_from_fewer_bytes(message: Any) -> None:
    data = serialize_checked(message)
    assert data == serialize(deserialize_message(data, type(message)))
    assert len(data) <= len(serialize_message(message))


def test_two_empty_sequences_of_doubles_take_eight_bytes() -> None:
    """What the serializer of rclpy gets wrong."""
    assert len(serialize(JointState(name=["shoulder", "elbow"], position=[1.0, 2.0]))) == 84


def test_a_type_that_cannot_be_serialized_is_named() -> None:
    message = SimpleNamespace(
        get_fields_and_field_types=lambda: {"data": "wstring"}, SLOT_TYPES=[UnboundedWString()], data="a"
    )
    with pytest.raises(ValueError, match="UnboundedWString"):
        serialize(message)


_PRINT = """
from sensor_msgs.msg import JointState
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from pidtsm_ros.wire import OutgoingMessage
from pidtsm_ros.serialization import serialize
print(OutgoingMessage(JointState(name=["abc", "de"]), ("effort",), joints=2).to_bytes(5).hex())
print(serialize(DiagnosticArray(status=[DiagnosticStatus(name="a")] * 3)).hex())
"""


def test_memory_that_was_not_written_does_not_leave() -> None:
    """glibc fills memory that is not initialised with the value of this variable."""
    outputs = {
        subprocess.run(
            [sys.executable, "-c", _PRINT], env={**os.environ, "MALLOC_PERTURB_": fill}, capture_output=True, check=True
        ).stdout
        for fill in ("85", "170")
    }
    assert len(outputs) == 1
