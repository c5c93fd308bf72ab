"""A gripper on real nodes, moved by clients written from the standard: what it holds is known when it closes."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration
from control_msgs.action import GripperCommand, ParallelGripperCommand
from geometry_msgs.msg import InertiaStamped
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from support.handy import ARM
from support.testbed import Testbed, open_testbed
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pidtsm_core.experiment import PRACTICAL, make_experiment
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_core.robots.definition import ArmDefinition
from pidtsm_core.signals import Mode
from pidtsm_experiments.runs.runner import node_parameters
from pidtsm_msgs.msg import ControllerState

HOME = [0.3, 0.4]
MASS, REACH, AT = 0.5, 0.3, 0.02
"""kg; from the elbow to the object, m; where the fingers touch it, m."""

LATE = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SMOOTH = 0.5
"""N m by which a torque changes at most from one sample to the next; the object takes 4.0 N m."""


class Handy:
    """The arm with its gripper, at rest, and a client of each standard."""

    def __init__(self, testbed: Testbed) -> None:
        self.testbed = testbed
        file = testbed.folder / "handy.urdf"
        file.write_text(ARM, encoding="utf-8")
        settings = [
            "simulator.rate=250",
            f"simulator.initial_position={HOME}",
            "simulator.gripper.joints=left right",
            f"simulator.gripper.object_mass={MASS}",
            f"simulator.gripper.object_at={AT}",
            f"simulator.gripper.object_center_of_mass=[{REACH}, 0.0, 0.0]",
            "controller.payload.from_gripper=true",
            "controller.watchdog.state_stop=5.0",
            "controller.watchdog.reference=5.0",
            "simulator.command.timeout=5.0",
            "trajectory.reference.amplitude=0.0",
            f"trajectory.reference.offset={HOME}",
        ]
        arm = ArmDefinition(str(file), ("shoulder", "elbow"), {"left": 0.04, "right": -0.04})
        experiment = make_experiment(None, None, 1.0, [PRACTICAL], settings, arm)
        words = []
        for node, values in node_parameters(experiment, "realtime").items():
            path = testbed.folder / f"{node}.yaml"
            path.write_text(ros_parameters(node, {**values, **LOOP[node]}), encoding="utf-8")
            words += ["--params-file", str(path)]
        self.states = testbed.hear(ControllerState, "controller/state", 1000)
        self.joints = testbed.hear(JointState, "joint_states", 100)
        self.objects = testbed.hear(InertiaStamped, "gripper/object", LATE)
        self.trajectories = testbed.node.create_publisher(JointTrajectory, "gripper/joint_trajectory", 10)
        self.single = ActionClient(testbed.node, GripperCommand, "gripper/gripper_cmd")
        self.parallel = ActionClient(testbed.node, ParallelGripperCommand, "gripper/parallel_gripper_cmd")
        self.loop = testbed.processes.start("composed", words, testbed.environment, testbed.folder / "composed.log")
        testbed.spin_until(lambda: self.states and self.states[-1].mode == Mode.FOLLOWING, "the arm follows")
        testbed.spin_until(lambda: self.single.server_is_ready() and self.parallel.server_is_ready(), "the actions")

    def send(self, client: Any, command: Any, feedback: Any = None) -> Any:
        """The result of a goal, or None if it is rejected."""
        goal = GripperCommand.Goal() if client is self.single else ParallelGripperCommand.Goal()
        goal.command = command
        sent = client.send_goal_async(goal, feedback_callback=feedback)
        self.testbed.spin_until(sent.done, "an answer to the goal")
        handle = sent.result()
        if not handle.accepted:
            return None
        done = handle.get_result_async()
        self.testbed.spin_until(done.done, "the result")
        return done.result().result

    def close_to(self, position: float, effort: float = 0.0) -> Any:
        command = GripperCommand.Goal().command
        command.position, command.max_effort = position, effort
        return self.send(self.single, command)

    def place(self, joint: str) -> float:
        """Where the last joint state has a joint."""
        message = self.joints[-1]
        return float(message.position[list(message.name).index(joint)])

    def known(self) -> float:
        """The payload that the controller has as a parameter, kg."""
        request = GetParameters.Request(names=["payload.mass"])
        return float(self.testbed.call(GetParameters, "controller/get_parameters", request).values[0].double_value)

    def rest(self) -> Any:
        """Wait until the arm rests where it should; its effort then."""
        begun = len(self.states)

        def rests() -> bool:
            recent = self.states[begun:][-50:]
            errors = np.array([state.position_error for state in recent])
            return len(recent) == 50 and bool(np.abs(errors).max() < 1e-3 and np.ptp(errors, axis=0).max() < 1e-5)

        self.testbed.spin_until(rests, "the arm rests")
        return np.array(self.states[-1].effort)


LOOP: dict[str, dict[str, Any]] = {
    "simulator": {"duration": 0.0, "start.subscribers": 2},
    "controller": {"start.subscribers": 1},
    "trajectory": {"start.subscribers": 1},
}


@pytest.fixture(scope="module")
def handy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Handy]:
    with open_testbed(tmp_path_factory.mktemp("handy")) as testbed:
        yield Handy(testbed)


def gravity(mass: float) -> Any:
    """What holds the object up at `HOME`, N m: by the lever of each joint."""
    fore = REACH * np.cos(sum(HOME))
    return -mass * 9.81 * np.array([0.4 * np.cos(HOME[0]) + fore, fore])


def test_what_it_holds_is_known_when_it_closes_and_when_it_opens(handy: Handy) -> None:
    empty = handy.rest()
    begun = len(handy.states)
    result = handy.close_to(0.0, effort=20.0)
    assert result.stalled
    assert not result.reached_goal
    assert (result.position, result.effort) == (AT, 20.0)
    handy.testbed.spin_until(lambda: handy.objects, "what is held")
    held = handy.objects[-1]
    assert held.header.frame_id == "lower"
    assert (held.inertia.m, held.inertia.com.x) == (MASS, REACH)
    handy.testbed.spin_until(lambda: handy.known() == MASS, "the controller knows it")
    loaded = handy.rest()
    np.testing.assert_allclose(loaded - empty, gravity(MASS), atol=0.05)
    steps = np.abs(np.diff([state.effort for state in handy.states[begun:]], axis=0)).max(axis=0)
    steps = np.abs(np.diff([state.effort for state in handy.states[begun:]], axis=0))
    assert steps.max() < SMOOTH
    assert handy.close_to(0.04).reached_goal
    handy.testbed.spin_until(lambda: handy.known() == 0.0, "the controller knows that it is gone")
    np.testing.assert_allclose(handy.rest(), empty, atol=0.05)
    assert handy.objects[-1].inertia.m == 0.0
    assert not handy.states[-1].fault
    assert {state.mode for state in handy.states[begun:]} == {Mode.FOLLOWING}


def test_a_parallel_gripper_is_commanded_by_names(handy: Handy) -> None:
    heard: list[Any] = []
    command = JointState(name=["left"], position=[0.03], velocity=[0.02])
    result = handy.send(handy.parallel, command, heard.append)
    assert result.reached_goal
    assert not result.stalled
    assert dict(zip(result.state.name, result.state.position, strict=True)) == pytest.approx(
        {"left": 0.03, "right": -0.03}
    )
    assert len(heard) >= 3, "0.5 s of motion"
    assert 0.03 < heard[0].feedback.state.position[0] < 0.04
    handy.testbed.spin_until(lambda: handy.place("right") == pytest.approx(-0.03), "joint_states have it")
    assert list(handy.joints[-1].name) == ["shoulder", "elbow", "left", "right"]
    assert len(handy.joints[-1].velocity) == len(handy.joints[-1].effort) == 4


def test_a_trajectory_moves_it_in_its_time(handy: Handy) -> None:
    points = [(0.1, 0.035), (0.3, 0.04)]
    message = JointTrajectory(joint_names=["left", "right"])
    for time, place in points:
        from_start = Duration(nanosec=round(1e9 * time))
        message.points.append(JointTrajectoryPoint(positions=[place, -place], time_from_start=from_start))
    handy.testbed.spin_until(lambda: handy.trajectories.get_subscription_count() == 1, "the gripper listens")
    begun = len(handy.joints)
    handy.trajectories.publish(message)
    handy.testbed.spin_until(lambda: handy.place("left") == 0.04, "its end")
    seen = [message.position[2] for message in handy.joints[begun:]]
    assert np.abs(np.diff(seen)).max() <= 0.1 / 250 + 1e-9, "gripper.velocity"
    assert seen == sorted(seen)


@pytest.mark.parametrize(
    ("position", "reason"),
    [(float("nan"), "the position of left is not finite"), (0.5, "left is to leave its range, 0 to 0.04")],
)
def test_a_goal_that_it_cannot_reach_is_rejected_with_a_reason(handy: Handy, position: float, reason: str) -> None:
    assert handy.close_to(position) is None
    handy.testbed.spin_until(
        lambda: f"goal of the gripper rejected: {reason}" in handy.loop.log.read_text(), "the reason in the log"
    )


def test_a_goal_ends_when_it_is_cancelled_or_another_comes(handy: Handy) -> None:
    slow = ParallelGripperCommand.Goal(command=JointState(name=["left"], position=[0.03], velocity=[0.001]))
    handles = []
    for _ in range(2):
        sent = handy.parallel.send_goal_async(slow)
        handy.testbed.spin_until(sent.done, "an answer")
        handles.append(sent.result())
    ends = [handle.get_result_async() for handle in handles]
    handy.testbed.spin_until(ends[0].done, "the end of the first")
    assert ends[0].result().status == GoalStatus.STATUS_ABORTED
    cancelled = handles[1].cancel_goal_async()
    handy.testbed.spin_until(lambda: cancelled.done() and ends[1].done(), "the end of the second")
    assert ends[1].result().status == GoalStatus.STATUS_CANCELED
    before = handy.place("left")
    assert before > 0.03
    begun = len(handy.joints)
    handy.testbed.spin_until(lambda: len(handy.joints) > begun + 20, "joint states")
    assert handy.place("left") == pytest.approx(before, abs=1e-4)


@pytest.mark.parametrize(
    ("frame", "mass", "inertia", "reason"),
    [
        ("camera", 1.0, 0.0, "the object is in the frame 'camera'; it must be in that of the tool, 'lower'"),
        ("lower", float("nan"), 0.0, "the object has a number that is not finite, or absurd"),
        ("", 1.0, -1.0, "no body has such a mass or inertia"),
    ],
)
def test_a_controller_refuses_an_object_that_cannot_be(
    handy: Handy, frame: str, mass: float, inertia: float, reason: str
) -> None:
    driver = handy.testbed.node.create_publisher(InertiaStamped, "gripper/object", LATE)
    message = InertiaStamped()
    message.header.frame_id, message.inertia.m, message.inertia.ixx = frame, mass, inertia
    handy.testbed.spin_until(lambda: driver.get_subscription_count() == 2, "the controller listens")
    driver.publish(message)
    log = handy.loop.log
    handy.testbed.spin_until(lambda: f"rejected gripper/object: {reason}" in log.read_text(), "the reason in the log")
    assert handy.known() == 0.0
    handy.testbed.node.destroy_publisher(driver)
