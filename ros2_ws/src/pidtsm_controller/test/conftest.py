"""The package's nodes in the test's process, with a node in the place of all others.

Domain and namespace are their own: a node that becomes active must command no arm.
"""

import secrets
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from domain_coordinator import domain_id
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from pidtsm_ros.process import MakeNode
from pidtsm_ros.stop import Stop

DEADLINE = 30.0
"""s; only a failing test waits that long."""


class Unsignalled(Stop):
    """Takes no signals: they stay with the tests."""

    def __init__(self) -> None:
        self.requested = False


class Graph:
    """A node under test and a stranger, spun together."""

    def __init__(self, make_node: MakeNode, *parameters: str) -> None:
        namespace = f"__ns:=/test_{secrets.token_hex(4)}"
        words = [word for parameter in parameters for word in ("-p", parameter)]
        rclpy.init(args=["--ros-args", "-r", namespace, *words])
        self.node = make_node(Unsignalled())
        self.stranger = Node("stranger")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._executor.add_node(self.stranger)

    def until(self, condition: Callable[[], Any], act: Callable[[], object] = lambda: None) -> None:
        """Spin until the condition holds; act before each look."""
        end = self.stranger.get_clock().now().nanoseconds + int(DEADLINE * 1e9)
        while not condition():
            assert self.stranger.get_clock().now().nanoseconds < end, "the condition never holds"
            act()
            self._executor.spin_once(timeout_sec=0.01)

    def close(self) -> None:
        self._executor.shutdown()
        self.stranger.destroy_node()
        self.node.destroy_node()
        rclpy.shutdown()


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Graph]]:
    graphs: list[Graph] = []

    def make(make_node: MakeNode, *parameters: str) -> Graph:
        graphs.append(Graph(make_node, *parameters))
        return graphs[0]

    with domain_id() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield make
        for each in graphs:
            each.close()
