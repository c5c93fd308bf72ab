"""Changes of the payload that the controller knows: without a step of the torque, and then as parameters."""

import numpy as np
from geometry_msgs.msg import InertiaStamped
from rclpy.parameter import Parameter as RosParameter

from pidtsm_core.control import Controller
from pidtsm_core.control.payload_blend import PayloadBlend
from pidtsm_core.experiment.node_parameters import FRAME_PREFIX, HELD_OBJECT
from pidtsm_core.parameters.joints import ABSURD, MessageError
from pidtsm_core.robots import TreeRobot, find_robot, payload_of
from pidtsm_core.robots.payload import Payload, payload_settings, possible_inertia, together
from pidtsm_core.timing import seconds
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.qos import KEPT

_LONGEST = 0.02
"""Time by which a change advances at most at one joint state, s."""


class PayloadChange:
    """Leads the model of the controller to another payload, and then sets ``payload.*``."""

    def __init__(self, node: ManagedNode, controller: Controller) -> None:
        """Args: node: the controller node, while it is configured; controller: its controller."""
        self._node, self._controller = node, controller
        self._has_shape = isinstance(find_robot(node.values), TreeRobot)
        self._blend: PayloadBlend | None = None
        self._last = 0  # ns

    @property
    def under_way(self) -> bool:
        """Whether a change has begun and not ended."""
        return self._blend is not None

    def begin(self, payload: Payload) -> None:
        """Change to a payload, from whatever the model is now; at once if the controller is inactive."""
        if self._node.active:
            self._blend = PayloadBlend(self._controller, self._node.values, payload)
        else:
            self._set(payload)

    def reset(self) -> None:
        """End a change at once, before the controller becomes active."""
        if self._blend is not None:
            self._set(self._blend.payload)

    def update(self, stamp: int) -> None:
        """Go on with a change; `stamp` is that of the joint state that was answered, ns."""
        last, self._last = self._last, stamp
        if self._blend is None:
            return
        # After a gap or a set clock, no faster.
        self._blend.advance(min(max(seconds(stamp - last), 0.0), _LONGEST))
        if self._blend.done:
            self._set(self._blend.payload)

    def parameters_changed(self) -> None:
        """Go on after parameters were set anew."""
        if self._blend is not None:
            self._blend.advance(0.0)

    def _set(self, payload: Payload) -> None:
        self._blend = None
        values = payload_settings(payload, self._has_shape)
        self._node.set_parameters_atomically([RosParameter(name, value=value) for name, value in values.items()])
        self._node.get_logger().info(f"took over a payload of {payload.mass:.3g} kg")


class HeldObject:
    """Adds what a gripper says that it holds to the payload, and takes it away again."""

    def __init__(self, node: ManagedNode, change: PayloadChange) -> None:
        """Args: node: the controller node, while it is configured; change: what changes its payload."""
        self._node, self._change = node, change
        arm = find_robot(node.values)
        self._has_shape = isinstance(arm, TreeRobot)
        frame = arm.description.links.names[arm.description.tool_link] if isinstance(arm, TreeRobot) else ""
        self._frame = f"{node.values[FRAME_PREFIX.name]}{frame}"
        self._beside: Payload | None = None  # what the arm carries besides; None: nothing is held
        node.listen(InertiaStamped, HELD_OBJECT, self._take, while_inactive=True, profile=KEPT)

    def _take(self, message: InertiaStamped) -> None:
        held = self._read(message)
        if held.mass == 0.0:
            if self._beside is not None:
                self._change.begin(self._beside)
                self._beside = None
            return
        if self._beside is None:
            self._beside = payload_of(self._node.values)
        self._change.begin(together(self._beside, held))

    def _read(self, message: InertiaStamped) -> Payload:
        """What the message describes.

        Raises:
            MessageError: no body is such, or the arm cannot carry it.
        """
        frame, found = message.header.frame_id, message.inertia
        if frame not in ("", self._frame):
            raise MessageError(f"the object is in the frame {frame!r}; it must be in that of the tool, {self._frame!r}")
        xx, xy, xz, yy, yz, zz = (getattr(found, name) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
        held = Payload(
            found.m,
            np.array([found.com.x, found.com.y, found.com.z]),
            np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
        )
        if not all(np.abs(each).max() < ABSURD for each in held):
            raise MessageError("the object has a number that is not finite, or absurd")
        if held.mass < 0.0 or not possible_inertia(held.inertia):
            raise MessageError("no body has such a mass or inertia")
        if not self._has_shape and (held.center_of_mass.any() or held.inertia.any()):
            raise MessageError("the arm is a closed form, whose payload is a point mass at its tool")
        return held
