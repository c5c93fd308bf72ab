"""``ros2 topic pub --rate RATE TOPIC TYPE YAML`` where there is no ros2: rclpy and the message standard alone."""

import importlib
import shutil
import sys
import time
from typing import Any

import rclpy
import yaml


def words(rate: float, topic: str, kind: str, content: str) -> list[str]:
    """The command that publishes a message again and again, by ``ros2`` if it is there.

    Args:
        rate: messages per second.
        topic: full name.
        kind: message type, such as geometry_msgs/msg/PoseStamped.
        content: of the message, as YAML; what it lacks is zero.
    """
    start = ["ros2", "topic", "pub", "--rate"] if shutil.which("ros2") else [sys.executable, __file__]
    return [*start, str(rate), topic, kind, content]


def fill(message: Any, content: dict[str, Any]) -> Any:
    for name, value in content.items():
        setattr(message, name, fill(getattr(message, name), value) if isinstance(value, dict) else value)
    return message


def main() -> None:
    rate, topic, kind, content = sys.argv[1:]
    package, _, name = kind.split("/")
    message_type = getattr(importlib.import_module(f"{package}.msg"), name)
    message = fill(message_type(), yaml.safe_load(content))
    rclpy.init()
    publisher = rclpy.create_node("stranger_on_the_command_line").create_publisher(message_type, topic, 10)
    while True:
        publisher.publish(message)
        time.sleep(1.0 / float(rate))


if __name__ == "__main__":
    main()
