"""Visualization node: publishes the arm, its reference and its torques for RViz and Foxglove."""

import math
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import rclpy
from ament_index_python.packages import get_package_share_directory
from geometry_msgs.msg import Point, TransformStamped
from rclpy.exceptions import ParameterException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, Header, String
from visualization_msgs.msg import Marker, MarkerArray

from pidtsm_core.parameters import Array
from pidtsm_msgs.msg import JointReference
from pidtsm_ros.process import spin_for
from pidtsm_ros.qos import KEPT
from pidtsm_ros.startup import refuse, start_ros
from pidtsm_ros.stop import Stop
from two_link_sim.kinematics import Joint, UrdfError, link_poses, read_urdf

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # not available as a wheel
    TFMessage = None

GHOST = "reference"
"""TF prefix of the second arm, which shows the reference."""

_PERIOD = 0.02  # s; as fast as a screen can show
_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_FULL_TORQUE = 1.5 * math.pi  # rad of arc for a torque at its limit
_ARC_RADIUS = 0.3  # m
_ARC_POINTS = 24
_LINE_WIDTH = 0.03  # m


class VisualizationNode(Node):
    """Publishes ``robot_description``, ``tf`` and ``~/markers``, as often as a screen can show them.

    Parameter ``robot_description``: the URDF; default: the two-link arm.
    """

    def __init__(self) -> None:
        """Raises: UrdfError: the robot description cannot be displayed."""
        super().__init__("visualization")
        description = str(self.declare_parameter("robot_description", "").value) or _two_link()
        self._joints = read_urdf(description)
        self._newest = {"joint_states": JointState(), "joint_commands": JointState(), "reference": JointReference()}

        self.create_publisher(String, "robot_description", KEPT).publish(String(data=description))
        self._markers = self.create_publisher(MarkerArray, "~/markers", 1)
        self._tf = None if TFMessage is None else self.create_publisher(TFMessage, "tf", 100)
        if self._tf is None:
            self.get_logger().warning(
                "tf2_msgs is not installed, so tf is not published: viewers can show the torques, "
                "but the arm only from joint_states"
            )
        for topic, empty in self._newest.items():
            # Messages between two frames are never visible.
            self.create_subscription(type(empty), topic, partial(self._newest.__setitem__, topic), _NEWEST)

    def show(self) -> None:
        """Publish one frame from the messages received so far."""
        state, command, reference = self._newest.values()
        frames: list[TransformStamped] = []
        if state.name:
            positions = _by_joint(state.name, state.position)
            torques = _by_joint(command.name, command.effort)
            frames += transforms(self._joints, positions, state.header, "")
            self._markers.publish(MarkerArray(markers=torque_markers(self._joints, positions, torques, state.header)))
        if reference.name:
            desired = _by_joint(reference.name, reference.position)
            frames += transforms(self._joints, desired, reference.header, f"{GHOST}/")
        if frames and self._tf is not None:
            self._tf.publish(TFMessage(transforms=frames))


def _two_link() -> str:
    return Path(get_package_share_directory("two_link_sim"), "urdf", "two_link.urdf").read_text(encoding="utf-8")


def _by_joint(names: Sequence[str], values: Sequence[float]) -> dict[str, float]:
    """Values by joint, without values that are not finite."""
    return {name: value for name, value in zip(names, values, strict=False) if math.isfinite(value)}


def transforms(
    joints: Sequence[Joint], positions: dict[str, float], header: Header, prefix: str
) -> list[TransformStamped]:
    """Transform of every link relative to its parent.

    Args:
        joints: as returned by `read_urdf`.
        positions: rad, by joint.
        header: provides the stamp.
        prefix: prefix of every frame name; the root of an arm with a prefix coincides with that of the arm without.
    """
    root = joints[0].parent
    frames = [_transform(header, root, prefix + root, np.eye(4))] if prefix else []
    for joint in joints:
        pose = joint.pose(positions.get(joint.name, 0.0))
        frames.append(_transform(header, prefix + joint.parent, prefix + joint.child, pose))
    return frames


def _transform(header: Header, parent: str, child: str, pose: Array) -> TransformStamped:
    message = TransformStamped(header=Header(stamp=header.stamp, frame_id=parent), child_frame_id=child)
    place, turn = message.transform.translation, message.transform.rotation
    place.x, place.y, place.z = pose[:3, 3].tolist()
    turn.x, turn.y, turn.z, turn.w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
    return message


def torque_markers(
    joints: Sequence[Joint], positions: dict[str, float], torques: dict[str, float], header: Header
) -> list[Marker]:
    """An arc around each joint with a torque limit.

    It starts at the link and points in the direction of the torque; its colour turns from green to red at the limit.

    Args:
        joints: as returned by `read_urdf`.
        positions: rad, by joint.
        torques: N m, by joint; joints without a torque get no arc.
        header: provides the stamp.
    """
    poses = link_poses(joints, positions)
    markers = []
    for number, joint in enumerate(joints):
        if not joint.turns or joint.name not in torques or math.isinf(joint.effort):
            continue
        share = float(np.clip(torques[joint.name] / joint.effort, -1.0, 1.0))
        marker = Marker(
            header=Header(stamp=header.stamp, frame_id=joints[0].parent),
            ns="torque",
            id=number,
            type=Marker.LINE_STRIP,
            points=[Point(x=x, y=y, z=z) for x, y, z in _arc(joint, poses[joint.child], share).tolist()],
            color=ColorRGBA(r=abs(share), g=1.0 - abs(share), b=0.0, a=1.0),
        )
        marker.pose.orientation.w = 1.0
        marker.scale.x = _LINE_WIDTH
        markers.append(marker)
    return markers


def _arc(joint: Joint, pose: Array, share: float) -> Array:
    """Points in the root's frame, shape (points, 3), m."""
    along = np.eye(3)[np.argmin(np.abs(joint.axis))]
    along = along - (along @ joint.axis) * joint.axis
    along /= np.linalg.norm(along)
    across = np.cross(joint.axis, along)
    angles = np.linspace(0.0, share * _FULL_TORQUE, _ARC_POINTS)[:, np.newaxis]
    points = _ARC_RADIUS * (np.cos(angles) * along + np.sin(angles) * across)
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def run(stop: Stop) -> int:
    """``ros2 run two_link_sim visualization``: run until a signal; returns the exit code.

    Raises:
        SystemExit: invalid parameters, see `refuse`.
    """
    start_ros(stop)
    try:
        node = VisualizationNode()
    except (ParameterException, UrdfError) as error:
        refuse(error)
    executor = EventsExecutor()
    executor.add_node(node)
    while not stop.requested:
        time.sleep(_PERIOD)
        spin_for(executor, 0.0)
        node.show()
    executor.remove_node(node)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()
    return 0
