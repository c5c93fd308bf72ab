"""Stiffness by message, on a real controller that leans on a wall of MuJoCo's."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import GetParameters
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from support.testbed import Testbed, open_testbed
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pidtsm_core.arrays import Array
from pidtsm_core.experiment import make_experiment
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_experiments.runs.runner import node_parameters
from pidtsm_ros.stamps import nanoseconds

START = [0.0, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8]
WALL = '<mujoco><worldbody><geom type="box" size="0.5 0.05 1" pos="0.6 0.16 0.5"/></worldbody></mujoco>'
"""5 cm beside the last link."""
BEYOND = 0.166
"""Angle of the first joint at which the reference is 5 cm beyond the wall, rad."""
SOFT, HARD = 150.0, 3000.0
"""N/m"""
RATE = 500


def stiffness(*values: float, frame: str = "") -> WrenchStamped:
    message = WrenchStamped()
    message.header.frame_id = frame
    force, torque = message.wrench.force, message.wrench.torque
    force.x, force.y, force.z, torque.x, torque.y, torque.z = values
    return message


class Leaning:
    """A Panda whose reference goes 5 cm beyond a wall, in lockstep, with soft springs."""

    def __init__(self, testbed: Testbed) -> None:
        self.testbed = testbed
        scene = testbed.folder / "wall.xml"
        scene.write_text(WALL, encoding="utf-8")
        still = {"friction.coulomb": 0.0, "friction.viscous": 0.0}
        given: dict[str, dict[str, Any]] = {
            "simulator": {"engine": "mujoco", "initial_position": START, "scene": str(scene), "rate": RATE, **still},
            "controller": {
                "compensation.coulomb": 0.0,
                "compensation.viscous": 0.0,
                "compliance.space": "tool",
                "compliance.stiffness": [SOFT] * 3 + [50.0] * 3,
            },
            "trajectory": {"reference.name": "sines", "reference.amplitude": 0.0, "reference.offset": START},
        }
        experiment = make_experiment(None, None, 1.0, "practical", given, "panda")
        many = QoSProfile(depth=10_000)
        self.commands: list[JointState] = testbed.hear(JointState, "joint_commands", many)
        self.wrenches = {k: testbed.hear(WrenchStamped, f"simulator/contact/panda_link{k}", many) for k in range(1, 8)}
        self.tool = testbed.node.create_publisher(WrenchStamped, "controller/set_cartesian_stiffness", 10)
        self.joints = testbed.node.create_publisher(Float64MultiArray, "controller/set_joint_stiffness", 10)
        arguments = []
        for node, values in node_parameters(experiment, "lockstep").items():
            file = testbed.folder / f"{node}.yaml"
            endless = {"duration": 0.0} if node == "simulator" else {}
            file.write_text(ros_parameters(node, {**values, "start.subscribers": 1, **endless}), encoding="utf-8")
            arguments += ["--params-file", str(file)]
        self.process = testbed.processes.start(
            "composed", arguments, testbed.environment, testbed.folder / "composed.log"
        )

    def lean(self) -> None:
        """Lead the reference beyond the wall, once the arm has found out what acts on it."""
        trajectories = self.testbed.node.create_publisher(JointTrajectory, "joint_trajectory", 10)
        self.testbed.spin_until(trajectories.get_subscription_count, "the trajectory node")
        self.reach(1.5)
        there = JointTrajectoryPoint(positions=[BEYOND, *START[1:]], velocities=[0.0] * 7)
        there.time_from_start.sec = 2
        names = [f"panda_joint{k}" for k in range(1, 8)]
        trajectories.publish(JointTrajectory(joint_names=names, points=[there]))
        self.reach(self.time + 3.5)

    def reach(self, time: float) -> None:
        """Go on until a time of the arm, s."""
        self.testbed.spin_until(
            lambda: self.commands and nanoseconds(self.commands[-1].header.stamp) >= time * 1e9, f"{time} s"
        )

    @property
    def time(self) -> float:
        return nanoseconds(self.commands[-1].header.stamp) / 1e9

    def efforts(self, since: float) -> Array:
        """Commands, shape (samples, joints), N m."""
        return np.array([c.effort for c in self.commands if nanoseconds(c.header.stamp) >= since * 1e9])

    @property
    def force(self) -> float:
        """Of the wall, N."""
        forces = [heard[-1].wrench.force for heard in self.wrenches.values() if heard]
        return sum(math.hypot(force.x, force.y, force.z) for force in forces)

    def parameter(self, name: str) -> list[float]:
        request = GetParameters.Request(names=[name])
        answer = self.testbed.call(GetParameters, "controller/get_parameters", request)
        return list(answer.values[0].double_array_value)


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Leaning]:
    with open_testbed(tmp_path_factory.mktemp("stiffness")) as testbed:
        yield Leaning(testbed)


def test_a_stiffness_20_times_larger_in_contact_is_taken_over_without_a_step(arm: Leaning) -> None:
    arm.lean()
    soft, began = arm.force, arm.time
    for k in range(10):  # As a policy would send it.
        arm.tool.publish(stiffness(*[HARD] * 3, *[50.0] * 3, frame=("", "world", "panda_link0")[k % 3]))
    arm.reach(began + 4.0)
    steps = np.abs(np.diff(arm.efforts(began - 0.1), axis=0))
    assert steps.max() <= 1.0
    assert "frame_id" not in arm.process.log.read_text()
    assert soft < 25.0
    assert 80.0 < arm.force < 150.0


def test_the_parameter_has_what_came_by_message(arm: Leaning) -> None:
    def known() -> bool:
        return arm.parameter("compliance.stiffness") == [HARD] * 3 + [50.0] * 3

    arm.testbed.spin_until(known, "the parameter")
    arm.testbed.set("controller", {"compliance.damping": 0.9})
    before = arm.force
    arm.reach(arm.time + 1.0)
    assert arm.force == pytest.approx(before, rel=0.05)


REFUSED = [
    (stiffness(-1.0, *[100.0] * 5), "compliance.stiffness: -1.0 must be >= 0"),
    (stiffness(math.nan, *[100.0] * 5), "compliance.stiffness: nan must be finite"),
    (stiffness(1e30, *[100.0] * 5), "is absurd"),
    (stiffness(*[100.0] * 6, frame="camera"), "frame_id camera: stiffness is along the axes of world"),
    (
        Float64MultiArray(data=[10.0] * 7),
        "compliance.space is tool: set it to joint, or publish on ~/set_cartesian_stiffness",
    ),
]


@pytest.mark.parametrize(("message", "reason"), REFUSED)
def test_what_is_no_stiffness_is_refused_with_the_reason(arm: Leaning, message: Any, reason: str) -> None:
    before = arm.parameter("compliance.stiffness")
    (arm.joints if isinstance(message, Float64MultiArray) else arm.tool).publish(message)
    arm.testbed.spin_until(lambda: reason in arm.process.log.read_text(), reason)
    assert arm.parameter("compliance.stiffness") == before


def test_joints_get_theirs_in_the_same_way(arm: Leaning) -> None:
    arm.testbed.set("controller", {"compliance.space": "joint"})
    wanted = [20.0, 30.0, 20.0, 20.0, 20.0, 20.0, 25.0]
    arm.joints.publish(Float64MultiArray(data=[1.0, 2.0]))
    arm.testbed.spin_until(lambda: "one for each of the 7 joints" in arm.process.log.read_text(), "the reason")
    arm.joints.publish(Float64MultiArray(data=wanted))
    arm.testbed.spin_until(lambda: arm.parameter("compliance.joint_stiffness") == wanted, "the parameter")
