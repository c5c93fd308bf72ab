"""The gripper of the simulated arm as ROS sees it: its commands, and the object that it holds."""

from collections.abc import Mapping

import numpy as np
from geometry_msgs.msg import InertiaStamped, Vector3
from rclpy.parameter import Parameter as RosParameter
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

from pidtsm_core.experiment.node_parameters import FRAME_PREFIX, HELD_OBJECT
from pidtsm_core.parameters import Value
from pidtsm_core.parameters.joints import MessageError
from pidtsm_core.robots import TreeRobot, find_robot, payload_of
from pidtsm_core.robots.payload import Payload, payload_settings, together
from pidtsm_core.simulation.gripper import Gripper
from pidtsm_core.timing import NANOSECONDS
from pidtsm_ros.managed_node import ManagedNode
from pidtsm_ros.qos import KEPT, RELIABLE_READER
from pidtsm_ros.stamps import set_stamp

_NEVER = 1e9
"""Time at which a payload is picked up that has to wait, s."""
_LEAST = 1e-9
"""Duration of a payload, s; 0 would mean that it is never dropped."""


class SimulatedGripper:
    """Moves the gripper, lets the arm carry what it holds, and publishes that.

    Attributes:
        gripper: its joints; none: there is no gripper, and nothing happens.
    """

    def __init__(self, node: ManagedNode) -> None:
        """Args: node: the simulator, while it is configured."""
        self._node, self._log = node, node.get_logger()
        self.gripper = Gripper(node.values)
        self._held: Payload | None = None
        self._beside, self._before = Payload(0.0), dict[str, Value]()  # what the arm carries beside the object
        self._own: dict[str, Value] = {}  # the parameters of the payload, if they are those of the object
        self._actions = None
        if not self.gripper.joints:
            return
        robot = find_robot(node.values)
        assert isinstance(robot, TreeRobot)  # `Gripper` has checked it.
        self._frame = f"{node.values[FRAME_PREFIX.name]}{robot.description.links.names[robot.description.tool_link]}"
        self._publisher = node.advertise(InertiaStamped, HELD_OBJECT, KEPT)
        node.listen(JointTrajectory, "gripper/joint_trajectory", self._follow, profile=RELIABLE_READER)
        try:
            from two_link_sim.gripper_actions import GripperActions
        except ModuleNotFoundError:
            self._log.info("no action gripper/gripper_cmd, because control_msgs is missing: ./pidtsm actions builds it")
        else:
            self._actions = GripperActions(node, self.gripper)
        self._prepare()

    def advance(self, now: float, dt: float, stamp: int) -> None:
        """Move on.

        Args:
            now: simulated time, s.
            dt: time that passes, s.
            stamp: of the sample, ns.
        """
        if not self.gripper.joints:
            return
        self.gripper.advance(dt)
        if self.gripper.held is not self._held:
            self._take(self.gripper.held, now, stamp)
        if self._actions:
            self._actions.advance(dt)

    def parameters_changed(self) -> None:
        """Use other parameters."""
        if self.gripper.joints:
            before = self.gripper.object
            self.gripper.set_parameters(self._node.values)
            if self.gripper.object is not before:
                self._prepare()

    def _take(self, held: Payload | None, now: float, stamp: int) -> None:
        """Let the arm carry an object, or none; in a scene, what was held falls."""
        if held is not None:
            if self._held is None:
                self._look()
            self._carry(held, {"payload.time": 0.0, "payload.duration": 0.0})
        else:
            self._set(self._before or {"payload.duration": max(now, _LEAST)})
        self._held = held
        message = InertiaStamped(header=Header(frame_id=self._frame))
        set_stamp(message.header.stamp, stamp)
        if held is not None:
            message.inertia.m = held.mass
            message.inertia.com = Vector3(**dict(zip("xyz", held.center_of_mass.tolist(), strict=True)))
        self._publisher.publish(message)
        self._log.info("the gripper holds nothing" if held is None else f"the gripper holds {held.mass:g} kg")

    def _look(self) -> None:
        """See what else the arm carries."""
        values = self._node.values
        own = bool(self._own) and all(np.array_equal(values[name], value) for name, value in self._own.items())
        self._beside = Payload(0.0) if own else payload_of(values)
        loads = {name: values[name] for name in values if name.startswith("payload.")}
        self._before = loads if self._beside.mass > 0.0 else {}

    def _prepare(self) -> None:
        """Make the object the payload, but one that is picked up later, unless the arm carries another.

        To compile a model for it takes MuJoCo too long for the moment at which the gripper closes.
        """
        if self._held is not None or (self.gripper.object.mass == 0.0 and not self._own):
            return
        self._look()
        if not self._before:
            self._carry(self.gripper.object, {"payload.time": _NEVER, "payload.duration": 0.0})

    def _carry(self, held: Payload, when: dict[str, Value]) -> None:
        settings = payload_settings(together(self._beside, held), has_shape=True)
        self._own = {} if self._before else settings
        self._set({**settings, **when})

    def _set(self, changes: Mapping[str, Value]) -> None:
        parameters = [RosParameter(name, value=value) for name, value in changes.items()]
        self._node.set_parameters_atomically(parameters)

    def _follow(self, message: JointTrajectory) -> None:
        if not message.points:
            self.gripper.stop()
            return
        for point in message.points:
            given, wanted = len(point.positions), len(message.joint_names)
            if given != wanted:
                raise MessageError(f"a point has {given} positions for {wanted} joints")
        times = [point.time_from_start.sec + point.time_from_start.nanosec / NANOSECONDS for point in message.points]
        self.gripper.follow(message.joint_names, times, [list(point.positions) for point in message.points])
        if self._actions:
            self._actions.abort("preempted by a trajectory")
