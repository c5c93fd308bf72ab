"""A real arm under commission: its joint states, and the torques that answer them."""

import time
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState

from pidtsm_core.arrays import Array
from pidtsm_ros.qos import PUBLISHER, READER
from pidtsm_ros.security import prepare_process
from pidtsm_ros.stamps import nanoseconds, set_stamp
from pidtsm_studies.commissioning.arm import CommissionError, Measured

_FOUND_WITHIN = 15.0
"""s until joint states and a reader of the commands are found."""
_SILENT = 1.0
"""s without joint states after which the arm counts as gone."""
_COUNTED = 50
"""Joint states whose stamps tell the period."""
_POLL = 0.05  # s
_ABSURD = 1e4
"""rad or m; no joint of an arm is there."""


class RosPort:
    """See `Port` in pidtsm_studies; the joints of `joint_states` may have any order, and there may be others."""

    def __init__(self, joints: Sequence[str], namespace: str, words: Sequence[str], asked: Callable[[], None]) -> None:
        """Find the arm.

        Args:
            joints: names, in the order of the description.
            namespace: of the topics.
            words: arguments of ROS, such as ``-r joint_states:=/arm/joint_states``.
            asked: called before each joint state; it raises what shall end the motion.

        Raises:
            CommissionError: there is no such arm, it lacks joints, or somebody else commands it.
        """
        self._joints, self._asked = tuple(joints), asked
        self._context = rclpy.Context()
        arguments = ["commission", *(["--ros-args", *words] if words else [])]
        rclpy.init(args=prepare_process(arguments), context=self._context)
        self._node = Node("commission", context=self._context, namespace=namespace, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._newest: deque[JointState] = deque(maxlen=1)
        self._last = -1
        self._unusable = ""
        self._node.create_subscription(JointState, "joint_states", self._heard, READER)
        self._commands = self._node.create_publisher(JointState, "joint_commands", PUBLISHER)
        self._order: list[int] = []
        self._names: list[str] = []
        self.period = self._met()

    def _heard(self, message: JointState) -> None:
        self._newest.append(message)

    def _met(self) -> float:
        """The median of the periods, s, once the arm is there."""
        end = time.monotonic() + _FOUND_WITHIN
        stamps: list[int] = []
        while len(stamps) < _COUNTED or not self._commands.get_subscription_count():
            if time.monotonic() > end:
                lacks = "usable joint_states arrive" if len(stamps) < _COUNTED else "node reads joint_commands"
                why = self._unusable or "is the arm on, and in this ROS domain?"
                raise CommissionError(f"no {lacks} within {_FOUND_WITHIN:g} s: {why}")
            if self._next(_POLL) is not None:
                stamps.append(self._last)
        if self._node.count_publishers(self._commands.topic_name) > 1:
            raise CommissionError(f"somebody else publishes {self._commands.topic_name}; end it first")
        return float(np.median(np.diff(stamps[-_COUNTED:]))) * 1e-9

    def _next(self, timeout: float) -> Array | None:
        """Positions of the newest joint state that can be used and is later than the last; None: there is none yet."""
        self._executor.spin_once(timeout_sec=timeout)
        if not self._newest:
            return None
        message = self._newest.pop()
        stamp = nanoseconds(message.header.stamp)
        if stamp <= self._last or not self._is_usable(message):
            return None
        self._last = stamp
        return np.array(message.position)[self._order]

    def _is_usable(self, message: JointState) -> bool:
        """Whether a joint state has finite positions of all joints; somebody else's gripper may publish others."""
        names = list(message.name)
        if names != self._names:
            if missing := [joint for joint in self._joints if joint not in names]:
                self._unusable = f"joint_states lack {', '.join(missing)}; they have {', '.join(names)}"
                return False
            self._names, self._order = names, [names.index(joint) for joint in self._joints]
        if len(message.position) != len(names) or not np.all(np.abs(message.position) < _ABSURD):
            self._unusable = (
                f"joint_states have {len(message.position)} positions for {len(names)} joints, or absurd ones"
            )
            return False
        self._unusable = ""
        return True

    def sense(self) -> Measured | None:
        """See `Port`.

        Raises:
            CommissionError: no joint state comes any more that can be used.
        """
        self._asked()
        end, late = time.monotonic() + _SILENT, False
        while (position := self._next(_POLL)) is None:
            if late:
                raise CommissionError(f"no usable joint_states for {_SILENT:g} s. {self._unusable}".strip())
            # Whoever was kept from running that long finds what has arrived meanwhile.
            late = time.monotonic() > end
        return Measured(self._last, position)

    def act(self, effort: Array | None) -> None:
        """See `Port`."""
        if effort is None or self._last < 0 or not np.all(np.isfinite(effort)):
            return
        message = JointState(name=list(self._joints), effort=effort.tolist())
        set_stamp(message.header.stamp, self._last)
        self._commands.publish(message)

    def close(self) -> None:
        """Leave the system; commands cease."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()
