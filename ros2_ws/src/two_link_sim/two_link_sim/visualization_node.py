"""Visualization node: publishes the arm, its reference and its efforts for RViz and Foxglove."""

import math
import time
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
import rclpy
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from rclpy.exceptions import ParameterException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from pidtsm_core.arrays import Array
from pidtsm_core.experiment.node_parameters import FRAME_PREFIX, visualization_schema
from pidtsm_core.parameters import ParameterError, Value, names
from pidtsm_core.robots import find_description, robot_joints
from pidtsm_core.robots.description import read_description
from pidtsm_core.robots.picture import reach
from pidtsm_core.robots.placement import joint_placements, link_placements
from pidtsm_msgs.msg import JointReference
from pidtsm_ros.parameters import declare
from pidtsm_ros.process import spin_for
from pidtsm_ros.qos import KEPT
from pidtsm_ros.serialization import ExactPublisher
from pidtsm_ros.startup import refuse, start_ros
from pidtsm_ros.stop import Stop
from two_link_sim.drawing import effort_markers, skeleton, transforms

_PERIOD = 0.02  # s; as fast as a screen can show
_FINEST = 1e-4  # rad or m; by which other joints must have moved to be placed anew
_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class VisualizationNode(Node):
    """Publishes ``robot_description``, ``tf`` and ``~/markers``, as often as a screen can show them."""

    def __init__(self, stop: Stop) -> None:
        """Declare the parameters; `stop` ends the wait for a robot description.

        Raises:
            ParameterError: the robot cannot be shown.
            SystemExit: see `declare`.
        """
        super().__init__("visualization")
        values = declare(self, visualization_schema, robot_joints, stop)
        self._joints = names(values["joints"])
        self._arm = find_description(values)
        self._size = reach(self._arm)
        self._newest = {"joint_states": JointState(), "joint_commands": JointState(), "reference": JointReference()}

        descriptions = self.create_publisher(String, "robot_description", KEPT, publisher_class=ExactPublisher)
        self._markers = self.create_publisher(MarkerArray, "~/markers", 1, publisher_class=ExactPublisher)
        self._tf = self.create_publisher(TFMessage, "tf", 100, publisher_class=ExactPublisher)
        if self._arm.urdf:
            descriptions.publish(String(data=self._arm.urdf))
        else:
            self.get_logger().warning("viewers cannot read an MJCF, so robot_description is empty: they show markers")
        for topic, empty in self._newest.items():
            # Messages between two frames are never visible.
            self.create_subscription(type(empty), topic, partial(self._newest.__setitem__, topic), _NEWEST)
        self._prefix = str(values[FRAME_PREFIX.name])
        self._base = self._prefix + self._arm.links.names[0]
        self._place_base(values)

    def _place_base(self, values: Mapping[str, Value]) -> None:
        """Publish where the base is, once, if it is somewhere."""
        parent = str(values["base.parent"])
        if parent:
            x, y, z, *angles = np.asarray(values["base.pose"], dtype=np.float64).tolist()
            frame = TransformStamped(header=Header(frame_id=parent), child_frame_id=self._base)
            frame.transform.translation = Vector3(x=x, y=y, z=z)
            turn = Rotation.from_euler("xyz", angles).as_quat().tolist()
            frame.transform.rotation = Quaternion(**dict(zip("xyzw", turn, strict=True)))
            static = self.create_publisher(TFMessage, "tf_static", KEPT, publisher_class=ExactPublisher)
            static.publish(TFMessage(transforms=[frame]))
        self.get_logger().info(f"the fixed frame is {parent or self._base}")

    def show(self) -> None:
        """Publish one frame from the messages received so far."""
        state, command, reference = self._newest.values()
        self._move_others(state)
        links = self._arm.links
        frames: list[TransformStamped] = []
        markers: list[Marker] = []
        for message, ghost in ((state, False), (reference, True)):
            if message.name:
                placements = link_placements(self._arm, self._positions(message))
                frames += transforms(links, placements, message.header, self._prefix, ghost)
                markers.append(skeleton(links, placements, message.header, self._size, ghost))
        if state.name:
            placements = joint_placements(self._arm, self._positions(state))
            efforts = self._by_joint(command.name, command.effort)
            markers += effort_markers(self._arm, placements, efforts, state.header, self._size)
        if frames:
            for marker in markers:
                marker.header.frame_id = self._base
            self._tf.publish(TFMessage(transforms=frames))
            self._markers.publish(MarkerArray(markers=markers))

    def _move_others(self, state: JointState) -> None:
        """Place the joints that do not belong to the arm, such as those of a gripper, where a joint state has them."""
        given = zip(state.name, state.position, strict=False)
        places = {name: value for name, value in given if name in self._arm.others and math.isfinite(value)}
        locked = self._arm.locked
        if any(abs(value - locked[name]) > _FINEST for name, value in places.items()):
            self._arm = read_description(self._arm.text, self._arm.joints, {**locked, **places})

    def _positions(self, message: JointState | JointReference) -> Array:
        """Positions in the order of the joints, shape (joints,), rad or m; 0 if the message has none."""
        return np.nan_to_num(self._by_joint(message.name, message.position))

    def _by_joint(self, named: Sequence[str], values: Sequence[float]) -> Array:
        """Values in the order of the joints, shape (joints,); nan if they are missing or not finite."""
        found = {name: value for name, value in zip(named, values, strict=False) if math.isfinite(value)}
        return np.array([found.get(joint, math.nan) for joint in self._joints])


def run(stop: Stop) -> int:
    """``ros2 run two_link_sim visualization``: run until a signal; returns the exit code.

    Raises:
        SystemExit: invalid parameters, see `refuse`.
    """
    start_ros(stop)
    try:
        node = VisualizationNode(stop)
    except (ParameterException, ParameterError) as error:
        refuse(error)
    executor = EventsExecutor()
    executor.add_node(node)
    while not stop.requested:
        time.sleep(_PERIOD)
        spin_for(executor, 0.0)
        node.show()
    executor.remove_node(node)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()
    return 0
