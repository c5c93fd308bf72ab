"""The wrench on the tool, without a sensor of forces: estimated from what acts on the joints, and published."""

import numpy as np
from geometry_msgs.msg import WrenchStamped

from pidtsm_core.control import Controller
from pidtsm_core.control.state import External
from pidtsm_core.experiment.node_parameters import FRAME_PREFIX
from pidtsm_core.poses.wrench import ToolWrench
from pidtsm_core.robots import TreeRobot, find_robot
from pidtsm_core.timing import NANOSECONDS
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.stamps import set_stamp

_PERIOD = NANOSECONDS // 50
"""Period of the messages, ns; the estimate is averaged over 0.1 s."""


class WrenchWatch:
    """Publishes the estimate on ``~/external_wrench``, and serves ``~/zero_external_wrench``."""

    def __init__(self, node: ManagedNode, controller: Controller) -> None:
        """Args: node: the controller node, while it is configured; controller: its controller."""
        self._node, self._controller = node, controller
        robot = find_robot(node.values)
        self._wrench = ToolWrench(robot, node.values)
        links = robot.description.links.names if isinstance(robot, TreeRobot) else ("tool",)
        frame = links[robot.description.tool_link if isinstance(robot, TreeRobot) else 0]
        self._frame = f"{node.values[FRAME_PREFIX.name]}{frame}"
        self._publisher = node.advertise(WrenchStamped, "~/external_wrench")
        node.offer("~/zero_external_wrench", self._zero)
        self.reset()

    def reset(self) -> None:
        """Begin anew, as the controller does when it becomes active."""
        self._usual = np.zeros(self._controller.joints)
        self._next = 0  # ns

    def update(self, stamp: int) -> None:
        """Take the sample that was answered; `stamp` is that of its joint state, ns."""
        if 0 <= self._next - stamp <= _PERIOD:  # Otherwise the clock was set.
            return
        self._next = stamp + _PERIOD
        state = self._controller.state
        wrench = self._wrench.of(self._controller.position, state.external[External.TWICE] - self._usual).tolist()
        message = WrenchStamped()
        set_stamp(message.header.stamp, stamp)
        message.header.frame_id = self._frame
        force, torque = message.wrench.force, message.wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = wrench
        self._publisher.publish(message)

    def _zero(self) -> str:
        """Take what acts now for none; returns the reason if refused, else an empty text."""
        if not self._node.active:
            return "the controller is inactive"
        self._usual = self._controller.state.external[External.TWICE].copy()
        self._controller.tare()
        return ""
