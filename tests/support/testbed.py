"""A testbed: real nodes in processes of their own, and a ROS node inside the test that talks to them."""

import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import rclpy
from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from pidtsm_experiments.runs.domain import own_domain
from pidtsm_experiments.runs.runner import Process, Processes
from pidtsm_ros.middleware import set_defaults

DEADLINE = 60.0
"""s; only a failing test waits that long. The first nodes on a machine compile."""

ASK_AGAIN = 3.0
"""s without an answer."""

REPEATABLE = (GetParameters, GetState, SetParametersAtomically)
"""Services that do the same when they are called twice."""


class Testbed:
    """A ROS domain of its own with real node processes, and a node of the test's.

    Attributes:
        folder: for logs and what else a test writes.
        node: of the test's, spun in `spin_until`.
    """

    __test__ = False  # Its name begins like that of a test.

    def __init__(self, folder: Path, domain: int, processes: Processes) -> None:
        set_defaults()  # Acknowledgements come as soon as for our nodes.
        self.folder = folder
        self.environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(folder / "ros")}
        self.processes = processes
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node("stranger", context=self.context)
        self.executor = EventsExecutor(context=self.context)
        self._clients: dict[str, Any] = {}
        self.executor.add_node(self.node)
        self._listeners: list[Node] = []

    def listener(self) -> Node:
        """Another node of the test's, in no executor."""
        self._listeners.append(Node("listener", context=self.context))
        return self._listeners[-1]

    def hear(self, message_type: Any, topic: str, qos: QoSProfile | int = 10) -> list[Any]:
        """Every message of a topic from now on, as `spin_until` receives them."""
        heard: list[Any] = []
        self.node.create_subscription(message_type, topic, heard.append, qos)
        return heard

    def start(self, name: str, *parameters: str) -> Process:
        """A process of one of our nodes, with parameters ``name:=value``; it is forked, see `nursery`."""
        return self.processes.start(name, _arguments(parameters), self.environment, self.folder / f"{name}.log")

    def start_executable(self, name: str, *parameters: str) -> Process:
        """The same from nothing, as ``ros2 run`` does it: for tests of the start itself."""
        process = Process(name, _arguments(parameters), self.environment, self.folder / f"{name}.log")
        self.processes.running[name] = process
        return process

    def spin_until(self, condition: Callable[[], Any], what: str) -> None:
        """Spin the test's node until the condition holds."""
        end = time.monotonic() + DEADLINE
        while not condition():
            if time.monotonic() > end:
                codes = {p.name: p.process.poll() for p in self.processes.running.values()}
                logs = "\n".join(f"{p.name}:\n{p.tail()}" for p in self.processes.running.values())
                pytest.fail(f"not within {DEADLINE:g} s: {what}; exit codes {codes}\n{logs}")
            self.executor.spin_once(timeout_sec=0.02)

    def call(self, service_type: Any, name: str, request: Any, again: bool = False) -> Any:
        """Call a service and return its response.

        A service is there a moment before its response finds the way back; what may be asked twice is asked again:
        the types in `REPEATABLE`, and what `again` says so of.
        """
        if name not in self._clients:
            self._clients[name] = self.node.create_client(service_type, name)
        client = self._clients[name]
        self.spin_until(client.service_is_ready, f"service {name}")
        futures = [client.call_async(request)]
        since = time.monotonic()

        def answered() -> bool:
            nonlocal since
            if (again or service_type in REPEATABLE) and time.monotonic() - since > ASK_AGAIN:
                futures.append(client.call_async(request))
                since = time.monotonic()
            return any(future.done() for future in futures)

        self.spin_until(answered, f"response of {name}")
        return next(future.result() for future in futures if future.done())

    def set(self, node: str, values: Mapping[str, Any]) -> None:
        """Set parameters of a node together."""
        messages = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        request = SetParametersAtomically.Request(parameters=messages)
        result = self.call(SetParametersAtomically, f"{node}/set_parameters_atomically", request).result
        assert result.successful, result.reason

    def close(self) -> None:
        self.executor.remove_node(self.node)
        self.executor.shutdown()
        self.node.destroy_node()
        for node in self._listeners:
            node.destroy_node()
        self.context.try_shutdown()


def _arguments(parameters: Iterable[str]) -> list[str]:
    return [word for parameter in parameters for word in ("-p", parameter)]


@contextmanager
def open_testbed(folder: Path) -> Iterator[Testbed]:
    """A testbed that keeps its logs in this folder; its processes end with the block."""
    with pytest.MonkeyPatch.context() as patch, own_domain() as domain, Processes() as processes:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        testbed = Testbed(folder, domain, processes)
        yield testbed
        testbed.close()
