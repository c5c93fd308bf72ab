"""Two arms on one graph, as two_arms.launch.py starts them: in one tree of frames, and neither hears the other."""

import math
import runpy
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.spatial.transform import Rotation
from support.testbed import Testbed, open_testbed
from tf2_msgs.msg import TFMessage

from pidtsm_core.experiment import PRACTICAL, make_experiment
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_core.robots import find_description
from pidtsm_core.robots.placement import link_placements
from pidtsm_core.signals import Mode
from pidtsm_experiments.runs.runner import Processes, node_parameters
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.client import Arm
from pidtsm_ros.stamps import nanoseconds, set_stamp

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "two_arms.py"
BASES = {"left": [0.0, 0.4, 0.1, 0.0, 0.0, 0.5 * math.pi], "right": [0.0, -0.4, 0.0, 0.0, 0.3, 0.0]}
HOME = [0.0, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8]
SHARED = {"/tf", "/tf_static", "/diagnostics", "/rosout", "/parameter_events"}
PANDA = find_description({"robot.description": "panda"})
TOOL = PANDA.links.names[PANDA.tool_link]
KEPT = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TIMES = {"controller.watchdog.state_stop": 5.0, "controller.watchdog.reference": 5.0, "simulator.command.timeout": 5.0}
"""s; a busy machine is no fault."""


def matrix(xyz: Any, turn: Rotation) -> Any:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = turn.as_matrix(), xyz
    return found


class Pair:
    """Both arms at rest, and what is on the shared topics of frames."""

    def __init__(self, testbed: Testbed, stack: ExitStack) -> None:
        self.testbed = testbed
        self.states = {side: testbed.hear(ControllerState, f"/{side}/controller/state", 10) for side in BASES}
        self.frames: dict[str, tuple[str, Any, int]] = {}
        testbed.node.create_subscription(TFMessage, "/tf", self._take, 2)
        testbed.node.create_subscription(TFMessage, "/tf_static", self._take, KEPT)
        for side, base in BASES.items():
            self._start(side, base, stack.enter_context(Processes()))
        testbed.spin_until(lambda: all(self.follows(side) for side in BASES), "both arms follow")

    def _start(self, side: str, base: list[float], processes: Processes) -> None:
        folder = self.testbed.folder / side
        folder.mkdir()
        settings = [f"{name}={value}" for name, value in TIMES.items()]
        settings += [f"{node}.frame_prefix={side}/" for node in ("simulator", "controller", "trajectory")]
        settings += ["trajectory.robot.description=panda", "trajectory.reference.amplitude=0.0", "simulator.rate=250"]
        settings += ["controller.state.decimation=10"]
        settings += [f"trajectory.reference.offset={HOME}", f"simulator.initial_position={HOME}"]
        experiment = make_experiment(None, None, 1.0, [PRACTICAL], settings, "panda")
        shared = ["-r", f"__ns:=/{side}", "-r", "tf:=/tf", "-r", "tf_static:=/tf_static"]
        words = list(shared)
        for node, values in node_parameters(experiment, "realtime").items():
            own = {"start.subscribers": 1, **({"duration": 0.0} if node == "simulator" else {})}
            file = folder / f"{node}.yaml"
            file.write_text(ros_parameters(f"/{side}/{node}", {**values, **own}), encoding="utf-8")
            words += ["--params-file", str(file)]
        processes.start("composed", words, self.testbed.environment, folder / "composed.log")
        shown = ["-p", f"frame_prefix:={side}/", "-p", "base.parent:=world", "-p", f"base.pose:={base}"]
        shown += ["-p", "robot.description:=panda"]
        processes.start("visualization", [*shared, *shown], self.testbed.environment, folder / "visualization.log")

    def _take(self, message: TFMessage) -> None:
        for each in message.transforms:
            t, r = each.transform.translation, each.transform.rotation
            place = matrix([t.x, t.y, t.z], Rotation.from_quat([r.x, r.y, r.z, r.w]))
            self.frames[each.child_frame_id] = (each.header.frame_id, place, nanoseconds(each.header.stamp))

    def follows(self, side: str) -> bool:
        states = self.states[side]
        return bool(states) and states[-1].mode == Mode.FOLLOWING

    def rests(self, side: str) -> bool:
        """Whether the arm was where it shall stay when its newest frames were measured."""
        newest = self.frames[f"{side}/{TOOL}"][2]
        before = [each for each in self.states[side] if nanoseconds(each.header.stamp) <= newest]
        return bool(before) and bool(np.abs(np.subtract(before[-1].position, HOME)).max() < 3e-4)

    def sees(self, nodes: set[tuple[str, str]]) -> bool:
        return nodes <= set(self.testbed.node.get_node_names_and_namespaces())

    def in_world(self, frame: str) -> Any:
        """Where a frame is, along the frames that were published."""
        found = np.eye(4)
        while frame != "world":
            frame, place, _ = self.frames[frame]
            found = place @ found
        return found


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pair]:
    with open_testbed(tmp_path_factory.mktemp("pair")) as testbed, ExitStack() as stack:
        yield Pair(testbed, stack)


def test_the_frames_of_both_arms_are_one_tree(pair: Pair) -> None:
    names = {f"{side}/{link}" for side in BASES for link in PANDA.links.names}
    pair.testbed.spin_until(lambda: pair.frames.keys() >= names, "all frames")
    pair.testbed.spin_until(lambda: all(pair.rests(side) for side in BASES), "both arms rest in their frames")
    for side, (x, y, z, roll, pitch, yaw) in BASES.items():
        base = matrix([x, y, z], Rotation.from_euler("xyz", [roll, pitch, yaw]))
        message = pair.states[side][-1]
        position = dict(zip(message.name, message.position, strict=True))
        placements = link_placements(PANDA, np.array([position[joint] for joint in PANDA.joints]))
        for link, place in zip(PANDA.links.names, placements, strict=True):
            found = pair.in_world(f"{side}/{link}")
            np.testing.assert_allclose(found[:3], (base @ np.vstack([place, [0, 0, 0, 1]]))[:3], atol=1e-3)


def test_no_node_hears_or_speaks_to_the_other_side(pair: Pair) -> None:
    node = pair.testbed.node
    for side in BASES:
        own = {(name, f"/{side}") for name in ("simulator", "controller", "trajectory", "visualization")}
        pair.testbed.spin_until(partial(pair.sees, own), "all nodes are known")
        for name, _ in own:
            for listing in (node.get_subscriber_names_and_types_by_node, node.get_publisher_names_and_types_by_node):
                topics = {topic for topic, _ in listing(name, f"/{side}")}
                assert topics
                assert {topic for topic in topics - SHARED if not topic.startswith(f"/{side}/")} == set()


def test_one_arm_moves_and_the_other_notices_nothing(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", pair.testbed.environment["ROS_DOMAIN_ID"])
    references = pair.testbed.hear(JointReference, "/right/reference", 100)
    pair.testbed.spin_until(lambda: references, "references of the right arm")
    with Arm("left", robot="panda", timeout=60.0) as left:
        left.move_to({PANDA.joints[0]: 0.2}, wait=False)
        aim = left.state.names.index(PANDA.joints[0])
        pair.testbed.spin_until(
            lambda: abs(pair.states["left"][-1].position[aim] - 0.2) < 0.01, "the left arm is there"
        )
    assert len({tuple(message.position) for message in references}) == 1
    assert not any(any(message.velocity) for message in references)


def test_the_example_moves_both(pair: Pair, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", pair.testbed.environment["ROS_DOMAIN_ID"])
    runpy.run_path(str(EXAMPLE))
    inwards, back = (eval(line) for line in capfd.readouterr().out.splitlines())
    for side, way in (("left", -0.1), ("right", 0.1)):
        np.testing.assert_allclose(np.subtract(inwards[side], back[side]), [0.0, way, 0.0], atol=2e-3)
        pair.testbed.spin_until(partial(pair.follows, side), "it follows")
        assert np.abs(pair.states[side][-1].position_error).max() < 5e-3
        assert not pair.states[side][-1].fault


def test_a_pose_in_the_world_reaches_the_arm_that_it_is_sent_to(pair: Pair) -> None:
    aim = pair.in_world(f"left/{TOOL}")
    aim[:3, 3] += [0.02, 0.0, 0.01]
    message = PoseStamped()
    message.header.frame_id = "world"
    p, o = message.pose.position, message.pose.orientation
    p.x, p.y, p.z = aim[:3, 3].tolist()
    o.x, o.y, o.z, o.w = Rotation.from_matrix(aim[:3, :3]).as_quat().tolist()
    publisher = pair.testbed.node.create_publisher(PoseStamped, "/left/trajectory/pose_target", 10)
    done = threading.Event()

    def stream() -> None:
        while not done.wait(0.02):
            set_stamp(message.header.stamp, time.time_ns())
            publisher.publish(message)

    thread = threading.Thread(target=stream)
    thread.start()
    try:
        pair.testbed.spin_until(
            lambda: np.linalg.norm(pair.in_world(f"left/{TOOL}")[:3, 3] - aim[:3, 3]) < 2e-3, "the tool is there"
        )
    finally:
        done.set()
        thread.join()
