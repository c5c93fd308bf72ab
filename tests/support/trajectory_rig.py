"""A trajectory node, and the test in the place of the arm, of the sender of trajectories, and of time."""

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from builtin_interfaces.msg import Duration
from numpy.typing import NDArray
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pidtsm_msgs.msg import JointReference
from pidtsm_ros.stamps import set_stamp
from support.testbed import Testbed

PRACTICAL = Path(__file__).parents[2] / "ros2_ws/src/pidtsm_core/pidtsm_core/experiment/params/practical.yaml"
NAMES = ["joint1", "joint2"]
PERMUTED = ["joint2", "joint1"]
FIELDS = ("positions", "velocities", "accelerations")


def point(t: float, *fields: list[float]) -> JointTrajectoryPoint:
    seconds = int(t)
    duration = Duration(sec=seconds, nanosec=round((t - seconds) * 1e9))
    return JointTrajectoryPoint(time_from_start=duration, **dict(zip(FIELDS, fields, strict=False)))


def trajectory(*points: JointTrajectoryPoint, names: list[str] = NAMES, start: float = 0.0) -> JointTrajectory:
    message = JointTrajectory(joint_names=names, points=points)
    set_stamp(message.header.stamp, round(start * 1e9))
    return message


def sine(t: float) -> NDArray[np.float64]:
    w = 0.4 * math.pi
    values = [0.3 * math.sin(w * t), 0.3 * w * math.cos(w * t), -0.3 * w * w * math.sin(w * t)]
    return np.transpose([values, values])


@dataclass
class Rig:
    """A trajectory node whose time is what the test says it is; the built-in motion is q = 0.3 sin 0.4 pi t.

    Attributes:
        arm: where it is measured, rad, in the order of `PERMUTED`.
    """

    testbed: Testbed
    references: list[JointReference] = field(default_factory=list)
    arm: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def __post_init__(self) -> None:
        node = self.testbed.node
        self.joint_states = node.create_publisher(JointState, "joint_states", 10)
        self.trajectories = node.create_publisher(JointTrajectory, "joint_trajectory", 10)
        node.create_subscription(JointReference, "reference", self.references.append, 10)
        self.process = self.testbed.start("trajectory", "reference.name:=sines", "clock:=lockstep")
        self.testbed.spin_until(
            lambda: (
                self.joint_states.get_subscription_count()
                and self.trajectories.get_subscription_count()
                and node.count_publishers("reference")
            ),
            "the trajectory node",
        )

    def publish(self, t: float) -> JointState:
        """A joint state of this time."""
        message = JointState(name=PERMUTED, position=self.arm)
        set_stamp(message.header.stamp, round(t * 1e9))
        self.joint_states.publish(message)
        return message

    def at(self, t: float) -> NDArray[np.float64]:
        """The reference that answers a joint state of this time, shape (3, joints)."""
        before = len(self.references)
        message = self.publish(t)
        self.testbed.spin_until(lambda: len(self.references) > before, f"the reference at {t} s")
        answer = self.references[-1]
        assert answer.header.stamp == message.header.stamp
        return np.array([answer.position, answer.velocity, answer.acceleration])

    def send(self, message: JointTrajectory, answer: str) -> None:
        """Send a trajectory, and wait for one more line in the log that holds the answer."""
        before = self.process.log.read_text().count(answer)
        self.trajectories.publish(message)
        self.testbed.spin_until(lambda: self.process.log.read_text().count(answer) > before, f"{answer!r} in the log")
