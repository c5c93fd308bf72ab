"""Frames from the topics ``tf`` and ``tf_static``, without tf2."""

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.poses.frames import Frames
from pidtsm_core.poses.pose import read_pose
from pidtsm_core.trajectories.errors import TrajectoryError
from pidtsm_ros.wire import deserialize

_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_DYNAMIC = QoSProfile(depth=10)


class Transforms:
    """Puts what is published into `Frames`. Transforms that are not finite, or no rotations, do not count."""

    def __init__(self, node: Node, frames: Frames) -> None:
        """Subscribe."""
        self._node, self._frames = node, frames
        self._subscriptions = [
            node.create_subscription(TFMessage, topic, self._receive, profile, raw=True)
            for topic, profile in (("tf_static", _STATIC), ("tf", _DYNAMIC))
        ]

    def destroy(self) -> None:
        """Receive nothing more."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []

    def _receive(self, data: bytes) -> None:
        try:
            message = deserialize(data, TFMessage)
        except MessageError:
            return
        for each in message.transforms:
            t, r = each.transform.translation, each.transform.rotation
            try:
                pose = read_pose((t.x, t.y, t.z), (r.x, r.y, r.z, r.w))
            except TrajectoryError:
                continue
            self._frames.place(each.child_frame_id, each.header.frame_id, pose)
