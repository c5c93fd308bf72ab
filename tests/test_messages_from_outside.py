"""Poses and twists as the command line and MoveIt Servo send them, on real nodes; MuJoCo judges where the tool is."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from support.strangerspublisher import words
from support.testbed import Testbed

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import PRACTICAL, make_experiment
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_core.robots import find_robot
from pidtsm_core.robots.tree_robot import TreeRobot
from pidtsm_experiments.runs.runner import node_parameters

BASE = "panda_link0"


class ToolByMuJoCo(NamedTuple):
    """Where the tool of the Panda is by MuJoCo's own reading of its URDF."""

    model: mujoco.MjModel
    data: mujoco.MjData
    link: str

    def at(self, state: JointState) -> tuple[Array, Rotation]:
        for name, q in zip(state.name, state.position, strict=True):
            self.data.qpos[self.model.joint(name).qposadr[0]] = q
        mujoco.mj_kinematics(self.model, self.data)
        body = self.data.body(self.link)
        return body.xpos.copy(), Rotation.from_matrix(body.xmat.reshape(3, 3))


@pytest.fixture(scope="module")
def tool() -> ToolByMuJoCo:
    panda = find_robot({"robot.description": "panda"})
    assert isinstance(panda, TreeRobot)
    text = panda.description.text.replace(
        "</robot>", '<mujoco><compiler fusestatic="false" discardvisual="true"/></mujoco></robot>'
    )
    model = mujoco.MjModel.from_xml_string(text)
    return ToolByMuJoCo(model, mujoco.MjData(model), panda.description.links.names[panda.description.tool_link])


@pytest.fixture
def states(testbed: Testbed) -> list[JointState]:
    """Joint states of a Panda in lockstep, whose built-in motion rests."""
    rest = [0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.8]
    overrides = ["simulator.duration=0.0", "simulator.rate=250", f"simulator.initial_position={rest}"]
    overrides += ["trajectory.reference.name=sines", "trajectory.reference.amplitude=0.0"]
    overrides += [f"trajectory.reference.offset={rest}"]
    experiment = make_experiment(None, robot="panda", params=[PRACTICAL], overrides=overrides)
    heard: list[JointState] = testbed.hear(JointState, "joint_states")
    for node, subscribers in ("simulator", 3), ("controller", 1), ("trajectory", 1):
        file = testbed.folder / f"{node}.yaml"
        values = {**node_parameters(experiment, "lockstep")[node], "start.subscribers": subscribers}
        file.write_text(ros_parameters(node, values), encoding="utf-8")
        testbed.processes.start(node, ["--params-file", str(file)], testbed.environment, testbed.folder / f"{node}.log")
    testbed.spin_until(lambda: heard, "the arm")
    return heard


@contextmanager
def published(testbed: Testbed, topic: str, kind: str, content: str) -> Iterator[None]:
    """While the block runs, another process publishes the message 100 times per second."""
    with (testbed.folder / "publisher.log").open("w") as log:
        process = subprocess.Popen(words(100, topic, kind, content), env=testbed.environment, stdout=log, stderr=log)
        try:
            yield
        finally:
            process.terminate()
            process.wait()


def test_a_pose_from_the_command_line_moves_the_tool_there(
    testbed: Testbed, states: list[JointState], tool: ToolByMuJoCo
) -> None:
    position, orientation = tool.at(states[-1])
    there = np.add(position, [-0.05, 0.08, -0.05])
    turned = Rotation.from_euler("z", 0.2) * orientation
    at = ", ".join(f"{axis}: {value:.6f}" for axis, value in zip("xyz", there, strict=True))
    as_quaternion = ", ".join(f"{axis}: {value:.9f}" for axis, value in zip("xyzw", turned.as_quat(), strict=True))
    content = f"{{header: {{frame_id: {BASE}}}, pose: {{position: {{{at}}}, orientation: {{{as_quaternion}}}}}}}"

    def arrived() -> bool:
        found = tool.at(states[-1])
        return bool(np.linalg.norm(found[0] - there) < 1e-3 and (found[1] * turned.inv()).magnitude() < 3e-3)

    with published(testbed, "/trajectory/pose_target", "geometry_msgs/msg/PoseStamped", content):
        testbed.spin_until(arrived, "the pose")


def test_a_twist_from_the_command_line_moves_the_tool_until_it_ends(
    testbed: Testbed, states: list[JointState], tool: ToolByMuJoCo
) -> None:
    start, orientation = tool.at(states[-1])
    content = f"{{header: {{frame_id: {BASE}}}, twist: {{linear: {{y: 0.1}}}}}}"
    with published(testbed, "/trajectory/twist_target", "geometry_msgs/msg/TwistStamped", content):
        testbed.spin_until(lambda: tool.at(states[-1])[0][1] - start[1] > 0.08, "the tool on its way")
    testbed.spin_until(lambda: np.abs(states[-1].velocity).max() < 2e-3, "rest")
    end, turned = tool.at(states[-1])
    assert end[1] - start[1] < 0.8
    np.testing.assert_allclose(end[[0, 2]], start[[0, 2]], atol=3e-3)
    assert (turned * orientation.inv()).magnitude() < 0.01
