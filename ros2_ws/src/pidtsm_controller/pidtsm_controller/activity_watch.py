"""Whether ros2_control applies the torques of this node, which its controller manager reports on /diagnostics.

The manager also publishes ``~/activity``, whose message the wheels of ROS 2 lack. /diagnostics has the same, once a
second, in a message that every ROS 2 has.
"""

import time

from diagnostic_msgs.msg import DiagnosticArray

from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.qos import RELIABLE_READER
from pidtsm_ros.wire import deserialize

_TOPIC = "/diagnostics"
_STATUS = ": Controllers Activity"
"""End of the name of the manager's status; before it is the name of the manager."""
_KEYS = ("{}.state", "{}")
"""Keys of the state of a controller, in Jazzy and before."""
_ACTIVE = "active"
_VALID = 3.0
"""s for which a report counts."""
_STARTING = 2
"""Reports after which a controller that has never been active is not just about to become active."""


class ActivityWatch:
    """Reads the state of the controller that forwards the torques, and deactivates the node if it applies none.

    Otherwise the law would go on against an arm that does not obey, and the first torque that does reach it would be
    what the law has wound up to.
    """

    def __init__(self, node: ManagedNode, topic: str) -> None:
        """Args: node: the controller node, while it is configured; topic: of the torques, CONTROLLER/commands."""
        self._node = node
        self._controller = node.resolve_topic_name(topic).split("/")[-2]
        self._manager = self._state = ""
        self._received = 0.0  # s
        self._idle = 0
        node.listen(DiagnosticArray, _TOPIC, self._receive, raw=True, while_inactive=True, profile=RELIABLE_READER)

    @property
    def trouble(self) -> str:
        """Why no torque reaches the arm; empty if it does, or if nothing is known."""
        if self._state in ("", _ACTIVE) or time.monotonic() - self._received > _VALID:
            return ""
        return f"{self._manager} reports that {self._controller} is {self._state}: activate it, then this node"

    def begin(self) -> None:
        """The node becomes active."""
        self._idle = 0

    def _receive(self, data: bytes) -> None:
        # Every node publishes on this topic: read what matters only.
        if _STATUS.encode() not in data:
            return
        for status in deserialize(data, DiagnosticArray).status:
            if not status.name.endswith(_STATUS):
                continue
            values = {value.key: value.value for value in status.values}
            states = [values[key] for form in _KEYS if (key := form.format(self._controller)) in values]
            if states:
                self._take(status.name.removesuffix(_STATUS), states[0])

    def _take(self, manager: str, state: str) -> None:
        """The manager reports this state."""
        if self._several(manager):
            self._state = ""
            return
        ended = self._state == _ACTIVE
        self._manager, self._state, self._received = manager, state, time.monotonic()
        self._idle = 0 if state == _ACTIVE else self._idle + 1
        if self._node.active and self._idle and (ended or self._idle >= _STARTING):
            self._node.get_logger().error(f"deactivated, because no torque reaches the arm: {self.trouble}")
            self._node.trigger_deactivate()

    def _several(self, manager: str) -> bool:
        """Whether several managers have this name, in different namespaces, which the status does not distinguish."""
        infos = self._node.get_publishers_info_by_topic(_TOPIC)
        return len({info.node_namespace for info in infos if info.node_name == manager}) > 1
