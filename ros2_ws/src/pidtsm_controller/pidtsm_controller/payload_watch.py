"""What the arm carries: estimated while it moves, published, and taken over on request."""

import numpy as np
from geometry_msgs.msg import InertiaStamped, Vector3

from pidtsm_controller.payload_change import PayloadChange
from pidtsm_core.control import Controller, Time
from pidtsm_core.experiment.node_parameters import FRAME_PREFIX
from pidtsm_core.identification.payload_observer import PayloadObserver
from pidtsm_core.parameters import as_float
from pidtsm_core.robots import TreeRobot, find_robot
from pidtsm_core.timing import NANOSECONDS, seconds
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.stamps import set_stamp

_PERIOD = NANOSECONDS // 10
"""Period of the messages, ns."""
_SEEN = 1.0
"""s of motion before which nothing is taken over."""
_CERTAIN, _LIGHT = 0.2, 0.1
"""Largest standard deviation of a mass that is taken over: as a share of it, and at least, kg."""


class PayloadWatch:
    """Publishes the estimate on ``~/payload``, and serves ``~/take_payload``."""

    def __init__(self, node: ManagedNode, controller: Controller, change: PayloadChange) -> None:
        """Begin.

        Args:
            node: the controller node, while it is configured.
            controller: its controller.
            change: what changes the payload that it knows.
        """
        self._node, self._controller, self._change = node, controller, change
        robot = find_robot(node.values)
        assert isinstance(robot, TreeRobot)  # The schema has checked it.
        self._robot = robot
        self._frame = f"{node.values[FRAME_PREFIX.name]}{robot.description.links.names[robot.description.tool_link]}"
        self._publisher = node.advertise(InertiaStamped, "~/payload")
        node.offer("~/take_payload", self._take)
        self.reset()

    def reset(self) -> None:
        """Forget everything, as the controller does when it becomes active."""
        self._observer: PayloadObserver | None = None  # It needs the period of the joint states.
        self._sent = np.zeros(self._controller.joints)
        self._next = 0  # ns

    def update(self, stamp: int) -> None:
        """Take the sample that was answered; `stamp` is that of its joint state, ns."""
        controller = self._controller
        if self._observer is None:
            if (period := controller.state.times[Time.PERIOD]) <= 0:
                return
            self._observer = PayloadObserver(self._robot, self._node.values, seconds(period))
            self._next = stamp
        else:
            applied = controller.measured[1] if controller.config.feeds_back else self._sent
            self._observer.update(controller.position, applied)
        np.copyto(self._sent, controller.state.sent)
        if stamp >= self._next:
            self._next = stamp + _PERIOD
            self._publish(self._observer, stamp)

    def _publish(self, observer: PayloadObserver, stamp: int) -> None:
        message, found = InertiaStamped(), observer.payload
        set_stamp(message.header.stamp, stamp)
        message.header.frame_id = self._frame
        message.inertia.m = found.mass
        x, y, z = found.center_of_mass.tolist()
        message.inertia.com = Vector3(x=x, y=y, z=z)
        self._publisher.publish(message)

    def _take(self) -> str:
        """Take over the estimate; returns the reason if refused, else an empty text."""
        largest = as_float(self._node.values["payload.largest"])
        if not self._node.active:
            return "the controller is inactive"
        if self._change.under_way:
            return "a payload is being taken over"
        if self._observer is None or self._observer.seen < _SEEN:
            return f"the arm has not moved for {_SEEN:g} s yet"
        found, deviation = self._observer.payload, self._observer.deviation
        if deviation > max(_CERTAIN * found.mass, _LIGHT):
            return f"the motion does not show the payload: {found.mass:.3g} kg, give or take {deviation:.2g} kg"
        if found.mass > largest:
            return f"{found.mass:.3g} kg exceeds payload.largest, {largest:g} kg"
        self._change.begin(found)
        return ""
