"""What a running system says of its nodes, over real services."""

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.srv import DescribeParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from pidtsm_core.control.findings import Finding, What
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.live.system import System
from pidtsm_experiments.runs.domain import own_domain


class _Interrupted(System):
    """Something happens to the node after it has described its parameters."""

    def __init__(self, happens: Callable[[], None]) -> None:
        super().__init__("/somewhere")
        self._happens = happens

    async def call(self, kind: Any, name: str, request: Any, within: float = 5.0) -> Any:
        answer = asyncio.ensure_future(super().call(kind, name, request, within))
        while not answer.done():
            self.spin()
            await asyncio.sleep(0.0)
        if kind is DescribeParameters:
            self._happens()
        return answer.result()


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Iterator[Node]:
    """A controller of two parameters."""
    with own_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        rclpy.init()
        node = Node("controller", namespace="/somewhere")
        node.declare_parameter("law.k1", 3.0)
        node.declare_parameter("law.k2", 4.0)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        spinning = threading.Thread(target=executor.spin)
        spinning.start()
        yield node
        executor.shutdown()
        spinning.join()
        node.destroy_node()
        rclpy.shutdown()


def _described(happens: Callable[[], None]) -> dict[str, Any]:
    system = _Interrupted(happens)
    try:
        found = asyncio.run(system.described("controller"))
    finally:
        system.close()
    assert all(each.descriptor.name == each.name for each in found)
    return {each.name: each.value for each in found}


def test_what_the_controller_states_on_diagnostics_is_known(node: Node) -> None:
    publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
    values = [KeyValue(key="rate (1/s)", value="1000"), KeyValue(key="found friction of elbow (N m)", value="6.1")]
    stated = DiagnosticArray(status=[DiagnosticStatus(name="somewhere/controller: loop", values=values)])
    other = DiagnosticArray(status=[DiagnosticStatus(name="elsewhere/controller: loop")])
    system, end = System("/somewhere"), time.monotonic() + 60.0
    try:
        while not system.found and time.monotonic() < end:
            publisher.publish(stated)
            publisher.publish(other)
            system.spin()
        assert system.found == (Finding(What.FRICTION, "elbow", 6.1, None, "N m"),)
    finally:
        system.close()


def test_a_node_that_is_another_one_halfway_is_read_anew(node: Node) -> None:
    def happens() -> None:
        if node.has_parameter("law.k2"):
            node.undeclare_parameter("law.k2")

    values = _described(happens)
    assert values["law.k1"] == 3.0
    assert "law.k2" not in values


def test_a_node_that_is_always_another_one_is_refused(node: Node) -> None:
    def happens() -> None:
        name = next(each for each in ("law.k1", "law.k2") if node.has_parameter(each))
        node.undeclare_parameter(name)
        node.declare_parameter("law.k2" if name == "law.k1" else "law.k1", 1.0)

    node.undeclare_parameter("law.k2")
    with pytest.raises(RefusedError, match="changed whenever they were read; is it started again and again"):
        _described(happens)
