"""Poses and twists of the tool become motions of the joints, and what cannot be followed is refused by name."""

import math
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TransformStamped, TwistStamped
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from pidtsm_controller.trajectory_node import TrajectoryNode
from pidtsm_core.arrays import Array
from pidtsm_core.robots import find_robot
from pidtsm_core.robots.tree_robot import TreeRobot
from pidtsm_core.trajectories.limits import motion_limits
from pidtsm_msgs.msg import JointReference
from pidtsm_ros.stamps import set_stamp

PANDA = find_robot({"robot.description": "panda"})
BASE = "panda_link0"
START = [0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.8]
MS = 1_000_000
SAMPLE = 4 * MS


def tool_by_mujoco(q: Array) -> tuple[Array, Array]:
    """Position and rotation of the tool of the Panda, from MuJoCo's own reading of the URDF."""
    assert isinstance(PANDA, TreeRobot)
    text, links = PANDA.description.text, PANDA.description.links
    end = text.rindex("</robot>")
    model = mujoco.MjModel.from_xml_string(text[:end] + '<mujoco><compiler fusestatic="false"/></mujoco></robot>')
    data = mujoco.MjData(model)
    data.qpos[:7] = q
    mujoco.mj_kinematics(model, data)
    body = data.body(links.names[PANDA.description.tool_link])
    return body.xpos.copy(), body.xmat.reshape(3, 3).copy()


class Rig:
    """A trajectory node of a Panda whose time the test decides; its built-in motion rests at `START`."""

    def __init__(self, graph: Callable[..., Any], tmp_path: Any) -> None:
        motion = tmp_path / "rest.csv"
        names = [f"{order}_{joint}" for order in ("q", "dq", "ddq") for joint in PANDA.joints]
        row = [*map(str, START), *["0.0"] * 14]
        lines = [",".join(["time", *names]), *(",".join([t, *row]) for t in ("0.0", "1.0"))]
        motion.write_text("\n".join(lines) + "\n")
        joints = "[" + ",".join(PANDA.joints) + "]"
        words = ("robot.description:=panda", f"joints:={joints}", "reference.name:=csv", f"reference.file:={motion}")
        self.made = graph(TrajectoryNode, "clock:=lockstep", "start.subscribers:=1", *words)
        self.references: list[JointReference] = []
        stranger, node = self.made.stranger, self.made.node
        stranger.create_subscription(JointReference, "reference", self.references.append, QoSProfile(depth=100))
        self.states = stranger.create_publisher(JointState, "joint_states", QoSProfile(depth=100))
        self.poses = stranger.create_publisher(PoseStamped, "trajectory/pose_target", 10)
        self.twists = stranger.create_publisher(TwistStamped, "trajectory/twist_target", 10)
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.transforms = stranger.create_publisher(TFMessage, "tf_static", kept)
        assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
        assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS
        publishers = (self.states, self.poses, self.twists)
        self.made.until(lambda: all(p.get_subscription_count() for p in publishers), node.poll)
        self.stamp = 1_000_000_000
        self.desired = self.go_on(1)

    def go_on(self, samples: int) -> Array:
        """References at samples 4 ms apart, shape (samples, 3, joints)."""
        found = []
        for _ in range(samples):
            self.stamp += SAMPLE
            message = JointState(name=list(PANDA.joints), position=START)
            set_stamp(message.header.stamp, self.stamp)
            before = len(self.references)
            self.states.publish(message)
            self.made.until(lambda before=before: len(self.references) > before)
            answer = self.references[-1]
            found.append([answer.position, answer.velocity, answer.acceleration])
        return np.array(found)

    def stream(self, publisher: Any, message: Any, frame: str = BASE, times: int = 1) -> Array:
        """Send a target at 50 Hz so many times; the references, shape (samples, 3, joints)."""
        found = []
        for _ in range(times):
            message.header.frame_id = frame
            set_stamp(message.header.stamp, self.stamp)
            publisher.publish(message)
            found.append(self.go_on(5))
        return np.concatenate(found)

    def refused(self, publisher: Any, message: Any, frame: str = BASE) -> None:
        """Send a target, and wait until the node has counted it as rejected."""
        before = self.made.node.rejected
        self.stream(publisher, message, frame)
        self.made.until(lambda: self.made.node.rejected > before, lambda: self.go_on(1))


@pytest.fixture
def rig(graph: Callable[..., Any], tmp_path: Any) -> Rig:
    return Rig(graph, tmp_path)


def pose(position: Array, quaternion: Array) -> PoseStamped:
    message = PoseStamped()
    message.pose.position.x, message.pose.position.y, message.pose.position.z = map(float, position)
    o = message.pose.orientation
    o.x, o.y, o.z, o.w = map(float, quaternion)
    return message


def quaternion(rotation: Array) -> Array:
    return np.asarray(Rotation.from_matrix(rotation).as_quat())


def test_the_tool_goes_where_a_pose_in_another_frame_says(rig: Rig) -> None:
    """The frame is given on tf_static, as a camera beside the arm would be."""
    position, rotation = tool_by_mujoco(np.array(START))
    wanted = np.add(position, [0.0, 0.1, -0.05]), Rotation.from_euler("z", 0.3).as_matrix() @ rotation
    camera = TransformStamped(child_frame_id="camera")
    camera.header.frame_id = BASE
    camera.transform.translation.x, camera.transform.translation.y = 1.0, -0.5
    camera.transform.rotation.z = camera.transform.rotation.w = math.sqrt(0.5)
    turn = Rotation.from_euler("z", 0.5 * math.pi).as_matrix()
    seen = turn.T @ (wanted[0] - [1.0, -0.5, 0.0]), turn.T @ wanted[1]
    rig.transforms.publish(TFMessage(transforms=[camera]))
    message = pose(seen[0], quaternion(seen[1]))
    rig.made.until(lambda: rig.made.node._poses._follower.frames.names, rig.made.node.poll)
    references = rig.stream(rig.poses, message, "camera", times=100)
    found = tool_by_mujoco(references[-1, 0])
    np.testing.assert_allclose(found[0], wanted[0], atol=1e-4)
    np.testing.assert_allclose(found[1], wanted[1], atol=1e-3)
    assert not references[-1, 1:].round(2).any()


def test_a_twist_moves_the_tool_until_no_more_come(rig: Rig) -> None:
    message = TwistStamped()
    message.twist.linear.y, message.twist.angular.z = 0.1, 0.2
    before = tool_by_mujoco(np.array(START))
    moving = rig.stream(rig.twists, message, times=75)
    early, late = (tool_by_mujoco(q) for q in (moving[-150, 0], moving[-1, 0]))
    elapsed = 149 * 0.004
    np.testing.assert_allclose((late[0] - early[0]) / elapsed, [0.0, 0.1, 0.0], atol=1e-3)
    turned = Rotation.from_matrix(late[1] @ early[1].T).as_rotvec() / elapsed
    np.testing.assert_allclose(turned, [0.0, 0.0, 0.2], atol=2e-3)
    resting = rig.go_on(150)
    np.testing.assert_allclose(resting[-1, 1:], 0.0, atol=1e-9)
    gone = tool_by_mujoco(resting[-1, 0])[0] - before[0]
    assert gone[1] <= 0.1 * (75 * 0.02 + 0.25 + 0.1)
    np.testing.assert_allclose(gone[[0, 2]], 0.0, atol=2e-3)


def test_a_twist_in_the_frame_of_the_tool_has_its_axes(rig: Rig) -> None:
    """As MoveIt Servo's users send it: about the origin of the tool, stamped by another clock."""
    assert isinstance(PANDA, TreeRobot)
    link = PANDA.description.links.names[PANDA.description.tool_link]
    position, rotation = tool_by_mujoco(np.array(START))
    message = TwistStamped()
    message.twist.linear.z = -0.1
    moving = rig.stream(rig.twists, message, link, times=50)
    gone, turned = tool_by_mujoco(moving[-1, 0])
    np.testing.assert_allclose(rotation.T @ (gone - position) / np.linalg.norm(gone - position), [0, 0, -1], atol=0.02)
    np.testing.assert_allclose(turned, rotation, atol=5e-3)
    assert np.linalg.norm(gone - position) == pytest.approx(0.1, abs=0.02)


def test_what_cannot_be_followed_is_refused_by_name(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    reasons: list[str] = []
    reject = rig.made.node.reject

    def note(reason: str) -> None:
        reasons.append(reason)
        reject(reason)

    monkeypatch.setattr(rig.made.node, "reject", note)
    good = [0.4, 0.0, 0.5], [1.0, 0.0, 0.0, 0.0]
    rig.refused(rig.poses, pose(np.array([math.nan, 0.0, 0.0]), np.array(good[1])))
    rig.refused(rig.poses, pose(np.array(good[0]), np.zeros(4)))
    rig.refused(rig.poses, pose(np.array(good[0]), np.array(good[1])), "moon")
    twist = TwistStamped()
    twist.twist.linear.x = math.inf
    rig.refused(rig.twists, twist)
    expected = (
        "pose_target: position (nan",
        "zero quaternion",
        "frame_id moon: the arm has no such link",
        "linear (inf",
    )
    for reason, part in zip(reasons, expected, strict=True):
        assert part in reason
    np.testing.assert_array_equal(rig.go_on(1), rig.desired)


def test_a_pose_out_of_reach_is_approached_within_limits_and_said(rig: Rig) -> None:
    position, rotation = tool_by_mujoco(np.array(START))
    references = rig.stream(rig.poses, pose(np.add(position, [1.5, 0.0, 0.0]), quaternion(rotation)), times=150)
    limits = motion_limits({"robot.description": "panda"})
    assert (np.abs(references[:, 1]) <= limits.planned_velocity).all()
    assert (np.abs(references[:, 2]) <= limits.acceleration * (1.0 + 1e-9)).all()
    assert tool_by_mujoco(references[-1, 0])[0][0] > position[0] + 0.1
    named = {reading.name: reading.value for reading in rig.made.node._poses.readings()}
    assert named["poses: distance to the target"] > 0.5


def test_without_an_arm_poses_are_refused_with_the_cure(graph: Callable[..., Any]) -> None:
    made = graph(TrajectoryNode, "clock:=lockstep", "start.subscribers:=0")
    poses = made.stranger.create_publisher(PoseStamped, "trajectory/pose_target", 10)
    reasons: list[str] = []
    made.node.reject = reasons.append
    made.node.trigger_configure()
    made.node.trigger_activate()
    made.until(lambda: poses.get_subscription_count() > 0)
    made.until(lambda: reasons, lambda: poses.publish(PoseStamped()))
    assert "poses need the arm: set robot.description" in reasons[0]
