"""The robot description that another node publishes, as robot_state_publisher does."""

from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from std_msgs.msg import String

from pidtsm_ros.qos import KEPT
from pidtsm_ros.stop import Stop

TOPIC = "robot_description"
_POLL = 0.1
"""Longest wait of the executor, s; Python runs signal handlers only between two waits."""


def receive_description(node: Node, stop: Stop) -> str:
    """Wait for the latched ``robot_description`` (std_msgs/String).

    Raises:
        SystemExit: the process was requested to end.
    """
    received: list[str] = []
    subscription = node.create_subscription(String, TOPIC, lambda message: received.append(message.data), KEPT)
    node.get_logger().info(f"waiting for a description on {subscription.topic_name}")
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        while not (received or stop.requested):
            executor.spin_once(timeout_sec=_POLL)
    finally:
        executor.remove_node(node)
        executor.shutdown()
        node.destroy_subscription(subscription)
    if not received:
        node.destroy_node()
        raise SystemExit(0)
    return received[0]
