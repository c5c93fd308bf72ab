"""Jogs of joints, which become a stream of targets of the joints."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pidtsm_controller.streams import Streams
from pidtsm_controller.trajectory_points import joint_values, places
from pidtsm_core.arrays import Array
from pidtsm_core.parameters import Value, as_float
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.poses.parameters import TWIST_TIMEOUT
from pidtsm_core.timing import NANOSECONDS, seconds
from pidtsm_core.trajectories.limits import MotionLimits
from pidtsm_ros.managed_node import ManagedNode

if TYPE_CHECKING:
    from control_msgs.msg import JointJog

JOG = "~/joint_jog"
_DEPTH = 10
"""Queue length: old jogs are useless."""
_TICK = NANOSECONDS // 100
"""Time between two targets, ns."""
_LONGEST = NANOSECONDS // 10
"""After a longer pause a jog begins afresh, ns."""


class JointJogs:
    """Receives ``control_msgs/JointJog`` on ``~/joint_jog``, if the interface is there: velocities of joints.

    The last message counts, until another target comes, or none for ``poses.twist_timeout``.
    """

    def __init__(self, node: ManagedNode, limits: MotionLimits, streams: Streams, values: Mapping[str, Value]) -> None:
        """Subscribe.

        Args:
            node: the trajectory node, while it is configured.
            limits: of the arm.
            streams: follow the targets of the joints.
            values: parameters of the node.
        """
        self._node, self._streams, self._limits = node, streams, limits
        self._timeout = round(as_float(values[TWIST_TIMEOUT.name]) * NANOSECONDS)
        self._velocity: Array | None = None  # shape (joints,), rad/s or m/s
        self._now = self._came = self._last = 0  # ns
        try:
            from control_msgs.msg import JointJog
        except ImportError:
            return  # The node logs that control_msgs is missing.
        node.listen(JointJog, JOG, self._on_jog, depth=_DEPTH)

    def forget(self) -> None:
        """A jog that has not been followed does not count any more."""
        self._velocity = None

    def advance(self, now: int) -> None:
        """Move on; call before the stream of the joints does.

        Args:
            now: stamp of the joint state, ns.
        """
        self._now = now
        if self._velocity is None:
            return
        if now - self._came > self._timeout or self._streams.source != JOG:
            self._velocity = None
        elif now - self._last >= _TICK:
            since, self._last = now - self._last, now
            elapsed = since if since < _LONGEST else _TICK
            try:
                self._streams.take_position(now, self._streams.held() + seconds(elapsed) * self._velocity)
            except MessageError as error:
                self._node.reject(f"{JOG}: {error}")

    def _on_jog(self, message: "JointJog") -> None:
        columns = places(message.joint_names, self._limits.joints, partial=True)
        if len(message.displacements):
            raise MessageError("displacements are not followed; send velocities")
        given = joint_values("velocities", message.velocities, columns.size)
        self._streams.held()  # Refused without a joint state.
        velocity = np.zeros(len(self._limits.joints))
        velocity[columns] = given
        fastest = self._limits.planned_velocity
        self._velocity = np.clip(velocity, -fastest, fastest)
        self._came, self._streams.source = self._now, JOG
