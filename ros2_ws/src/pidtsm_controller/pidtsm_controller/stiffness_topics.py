"""Stiffness by message: at any rate, where setting a parameter would take several periods of the loop."""

import time
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.parameter import Parameter
from std_msgs.msg import Float64MultiArray

from pidtsm_core.control import Controller
from pidtsm_core.control.compliance_parameters import SPACE, STIFFNESS_OF
from pidtsm_core.parameters import ParameterError, Value
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.robots import TreeRobot, find_robot
from pidtsm_ros.managed_node import ManagedNode

CARTESIAN, JOINT = "~/set_cartesian_stiffness", "~/set_joint_stiffness"
"""The first has the name and the type of https://github.com/matthias-mayr/Cartesian-Impedance-Controller."""
_TOPICS = {"tool": CARTESIAN, "joint": JOINT}
_OF_LAW = "law.stiffness_x"
"""A parameter of laws with springs of their own."""
_SILENT = 1.0
"""s without a message, after which the parameter gets the value."""


class StiffnessTopics:
    """Receives the stiffness of the tool as a wrench (N/m and N m/rad, axes of the base), and those of the joints."""

    def __init__(self, node: ManagedNode, controller: Controller) -> None:
        """Args: node: the controller node, while it is configured; controller: its controller."""
        self._node, self._controller = node, controller
        robot = find_robot(node.values)
        self._base, self._frames = robot.base, {"", robot.base}
        if isinstance(robot, TreeRobot):  # Other links that do not move may have the same axes.
            links = robot.description.links
            along = (links.rows < 0) & np.isclose(links.placements[:, :, :3], np.eye(3)).all(axis=(1, 2))
            self._frames |= {links.names[k] for k in np.flatnonzero(along)}
        self._came = 0.0  # s
        self._unsaved: dict[str, Value] = {}
        node.listen(WrenchStamped, CARTESIAN, self._on_wrench)
        node.listen(Float64MultiArray, JOINT, lambda message: self._take("joint", list(message.data)))

    def save(self) -> None:
        """Give the parameter what came by message, once no more comes; call it now and then."""
        if not self._unsaved or time.monotonic() - self._came < _SILENT:
            return
        unsaved, self._unsaved = self._unsaved, {}
        changed = [Parameter(name, value=value) for name, value in unsaved.items() if self._node.values[name] == value]
        if changed:  # Otherwise the parameter was set since.
            self._node.set_parameters(changed)

    def _on_wrench(self, message: WrenchStamped) -> None:
        if message.header.frame_id not in self._frames:
            raise MessageError(
                f"frame_id {message.header.frame_id}: stiffness is along the axes of {self._base}; name it, or none"
            )
        force, torque = message.wrench.force, message.wrench.torque
        self._take("tool", [force.x, force.y, force.z, torque.x, torque.y, torque.z])

    def _take(self, space: str, stiffness: Sequence[float]) -> None:
        present = str(self._node.values[SPACE.name])
        if present == "none" and _OF_LAW in self._node.values:
            raise MessageError(f"the law has its own springs: set {_OF_LAW} and the like as parameters")
        if present != space:
            other = f", or publish on {_TOPICS[present]}" if present in _TOPICS else ""
            raise MessageError(f"{SPACE.name} is {present}: set it to {space}{other}")
        name = STIFFNESS_OF[space].name
        try:
            value = self._controller.set_stiffness(space, stiffness)
        except ParameterError as error:
            raise MessageError(str(error)) from None
        self._node.values = {**self._node.values, name: value}
        self._unsaved[name], self._came = value, time.monotonic()
