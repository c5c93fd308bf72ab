"""docs/ros2-control.md: its files fit each other and our nodes, which run with them as it says."""

import importlib.util
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.action import ActionClient
from rclpy.serialization import deserialize_message
from support.launching import PROGRAM
from support.ros2controlplant import SECOND, Ros2Control
from support.testbed import DEADLINE, Testbed, open_testbed
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

import pidtsm_core
from pidtsm_core.experiment.node_parameters import NODE_SCHEMAS
from pidtsm_core.parameters import resolve
from pidtsm_core.robots import find_robot
from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.runner import Process
from pidtsm_msgs.msg import ControllerState

PAGE = Path(__file__).resolve().parents[1] / "docs" / "ros2-control.md"
TEXT = PAGE.read_text(encoding="utf-8")
FILES = dict(re.findall(r'^```\w+ title="([^"]+)"\n(.*?)^```$', TEXT, re.M | re.S))
STARTS = dict(re.findall(r"^ *\$ ros2 run pidtsm_controller (\w+) --ros-args (.*)$", TEXT, re.M))
GAINS = re.findall(r"`\./pidtsm (gains .*?)`", TEXT)[0]
JOINTS = list(find_robot({"robot.description": "panda"}).joints)
URDF = Path(pidtsm_core.__file__).parent / "robots" / "arms" / "panda.urdf"
RELIABLE = "qos_overrides./{}.subscription.reliability:=reliable"
STEP = 1.0
"""N m; the gravity that the arm carries is 19 N m."""
STILL = 2e-3  # rad
EFFORT = 87.0
"""N m; the largest torque limit of the arm."""
BEYOND = 3.0
"""rad from the start; no joint can turn so far."""
Result = FollowJointTrajectory.Result


def parameters(file: str) -> dict[str, dict[str, Any]]:
    return {node: content["ros__parameters"] for node, content in yaml.safe_load(FILES[file]).items()}


START = parameters("pidtsm.yaml")["trajectory"]["reference.from"]


def test_our_nodes_accept_their_parameters() -> None:
    ours = parameters("pidtsm.yaml")
    for node, given in ours.items():
        assert list(resolve(NODE_SCHEMAS[node], given, len(JOINTS))["joints"]) == JOINTS  # type: ignore[arg-type]
    assert ours["controller"]["output.type"] == "float64_multi_array"


def test_the_controllers_have_the_joints_of_our_nodes_in_their_order() -> None:
    theirs = parameters("ros2_controllers.yaml")
    for name in ("joint_state_broadcaster", "effort_controller"):
        assert theirs[name]["joints"] == JOINTS
        assert name in theirs["controller_manager"]
    assert theirs["effort_controller"]["interface_name"] == "effort"


def test_the_hardware_publishes_every_torque() -> None:
    hardware = ElementTree.fromstring(FILES["panda.ros2_control.xacro"])
    assert hardware.findtext(".//param[@name='trigger_joint_command_threshold']") == "-1"
    assert [place.get("name") for place in hardware.iterfind(".//command_interface")] == ["effort"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With the files of the page."""
    folder = tmp_path_factory.mktemp("page")
    for name, content in FILES.items():
        (folder / name).write_text(content)
    words = shlex.split(GAINS)
    words[words.index("--out") + 1] = str(folder / words[words.index("--out") + 1])
    assert main(words) == 0
    return folder


LAUNCH = ElementTree.fromstring(FILES["panda.launch.xml"])


def test_the_launch_file_starts_what_the_commands_start() -> None:
    started = {}
    for node in LAUNCH.iterfind("node"):
        files = [f"--params-file {param.get('from', '')}" for param in node.iterfind("param")]
        prefix = f'--prefix "{node.get("launch-prefix")}" ' if node.get("launch-prefix") else ""
        command = f"{prefix}{node.get('pkg')} {node.get('exec')} {node.get('args', '')}".strip()
        started[node.get("exec")] = " ".join([command, *(["--ros-args", *files] if files else [])])
    told = re.findall(r"^ *\$ ros2 run (.*?)(?: &)?$", TEXT, re.M)
    spawned = [words for words in told if " spawner " in words]
    assert started.pop("spawner").split()[2:4] == [words.split()[2] for words in reversed(spawned)]
    assert sorted(words.replace("$(dirname)/", "") for words in started.values()) == sorted(set(told) - set(spawned))


class Rig:
    """Our nodes, started as the page says, and an arm behind ros2_control.

    Attributes:
        plant: the arm.
        running: our nodes.
    """

    def __init__(self, testbed: Testbed, folder: Path, zeroes: bool) -> None:
        self.testbed, self._folder = testbed, folder
        self.plant = Ros2Control(testbed, URDF, JOINTS, START, zeroes)
        self.running: dict[str, Process] = {}
        self.goals = ActionClient(testbed.node, FollowJointTrajectory, "trajectory/follow_joint_trajectory")
        self._states: list[bytes] = []  # of the controller
        testbed.node.create_subscription(ControllerState, "controller/state", self._states.append, 10, raw=True)

    def start(self) -> None:
        """The commands of the page."""
        for node, words in STARTS.items():
            arguments = [str(self._folder / word) if word in (*FILES, "gains.yaml") else word for word in words.split()]
            # The plant needs every answer, however long the machine takes.
            given = [RELIABLE.format("joint_states")]
            if node == "controller":
                given += [RELIABLE.format("reference"), "watchdog.state_stop:=5.0"]
            arguments += [word for parameter in given for word in ("-p", parameter)]
            log = self.testbed.folder / f"{node}.log"
            self.running[node] = self.testbed.processes.start(node, arguments, self.testbed.environment, log)
            self.plant.go_on(60.0, lambda: self.plant.referred)  # So that no reference is lost.

    def follow(self) -> None:
        """Until the arm follows its reference, which the controller may discover seconds after the first command."""
        count = len(self.plant.commands)
        self.plant.go_on(60.0, lambda: len(self.plant.commands) > count)
        self.plant.awaits = True
        self._states.clear()
        assert self.plant.go_on(60.0, self._follows), "the reference is not followed"
        self.plant.go_on(1.0)

    def _follows(self) -> bool:
        newest = [deserialize_message(data, ControllerState) for data in self._states[-1:]]
        self._states.clear()
        return bool(newest and newest[0].mode == ControllerState.FOLLOWING)

    def says(self, node: str, text: str) -> bool:
        return text in self.running[node].log.read_text()

    def change(self, transition: int) -> bool:
        """Change the state of our controller; joint states go on."""
        client = self.testbed.node.create_client(ChangeState, "controller/change_state")
        self.plant.awaits = False
        self.plant.go_on(60.0, client.service_is_ready)
        future = client.call_async(ChangeState.Request(transition=Transition(id=transition)))
        self.plant.go_on(60.0, future.done)
        return bool(future.result().success)

    def send(self, by: float) -> Any:
        """Send a goal `by` rad from the start, 2 s long; returns its handle."""
        end = JointTrajectoryPoint(positions=[q + by for q in START], velocities=[0.0] * len(START))
        end.time_from_start = Duration(sec=2)
        self.plant.go_on(60.0, self.goals.server_is_ready)
        goal = FollowJointTrajectory.Goal(trajectory=JointTrajectory(joint_names=JOINTS, points=[end]))
        future = self.goals.send_goal_async(goal)
        self.plant.go_on(60.0, future.done)
        return future.result()

    def outcome(self, by: float) -> tuple[bool, int, str]:
        """Whether such a goal is accepted, its error code and its text."""
        handle = self.send(by)
        if not handle.accepted:
            return False, 0, ""
        future = handle.get_result_async()
        self.plant.go_on(60.0, future.done)
        result = future.result().result
        return True, int(result.error_code), str(result.error_string)

    def next_report(self) -> None:
        """Until the controller manager has just reported."""
        self.plant.go_on(1.0, lambda: self.plant.now % SECOND == 0)


@pytest.fixture
def make_rig(tmp_path: Path, folder: Path) -> Iterator[Any]:
    with open_testbed(tmp_path) as testbed:
        rigs: list[Rig] = []

        def make(zeroes: bool = False) -> Rig:
            rigs.append(Rig(testbed, folder, zeroes))
            return rigs[0]

        yield make
        for rig in rigs:
            rig.plant.close()


def largest(efforts: Any) -> float:
    """The largest torque, N m."""
    return float(np.abs(efforts).max())


def steps(efforts: list[Any]) -> float:
    """The largest change of the torque between two cycles in which it acts on the arm, N m."""
    return float(np.nanmax(np.abs(np.diff(efforts, axis=0))))


def farthest(positions: list[Any]) -> float:
    """Distance from the first, rad."""
    return float(np.abs(np.array(positions) - positions[0]).max())


def test_in_the_order_of_the_page_nothing_jumps(make_rig: Any) -> None:
    rig: Rig = make_rig()
    plant = rig.plant
    plant.switch(True)
    rig.start()
    rig.follow()
    assert steps(plant.efforts) < STEP, "from the first torque on"
    assert farthest(plant.positions) < STILL

    assert rig.change(Transition.TRANSITION_DEACTIVATE)
    plant.go_on(0.1)
    support = plant.efforts[-1]
    plant.switch(False)
    plant.go_on(0.1)
    again = len(plant.efforts)
    plant.switch(True)
    rig.next_report()
    np.testing.assert_array_equal(plant.efforts[again], support, "the hardware has kept the last torque")
    assert rig.change(Transition.TRANSITION_ACTIVATE)
    rig.follow()
    assert steps(plant.efforts) < STEP
    assert farthest(plant.positions) < STILL


STAND_IN = """#!{python}
import os, sys, time
from pathlib import Path
with Path("started").open("a") as file:
    print(Path(sys.argv[0]).name, *sys.argv[1:], file=file)
while Path(sys.argv[0]).name not in ("chrt", "spawner"):
    time.sleep(1.0)
if Path(sys.argv[0]).name == "chrt":
    os.execvp(sys.argv[3], sys.argv[3:])
"""
"""What the test starts in place of the programs of ros2_control; the plant, in this process, plays them."""


@pytest.mark.skipif(importlib.util.find_spec("launch_ros") is None, reason="launch_ros is not installed")
def test_the_launch_file_of_the_page_starts_an_arm_that_does_not_jump(make_rig: Any, folder: Path) -> None:
    rig: Rig = make_rig()
    plant, testbed = rig.plant, rig.testbed
    place = testbed.folder / "launched"
    prefix = place / "prefix"
    for name in (node for node in LAUNCH.iterfind("node") if node.get("pkg") != "pidtsm_controller"):
        package, program = name.get("pkg", ""), name.get("exec", "")
        index = prefix / "share" / "ament_index" / "resource_index" / "packages" / package
        for path in (index, prefix / "lib" / package / program, place / "bin" / "chrt"):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(STAND_IN.format(python=sys.executable))
            path.chmod(0o755)
    for file in folder.iterdir():
        (place / file.name).write_bytes(file.read_bytes())
    # The plant needs every answer, however long the machine takes.
    ours = yaml.safe_load(FILES["pidtsm.yaml"])
    for parameters in ours.values():
        for topic in ("joint_states", "reference"):
            parameters["ros__parameters"][f"qos_overrides./{topic}.subscription.reliability"] = "reliable"
    del ours["trajectory"]["ros__parameters"]["qos_overrides./reference.subscription.reliability"]
    ours["controller"]["ros__parameters"]["watchdog.state_stop"] = 5.0
    (place / "pidtsm.yaml").write_text(yaml.safe_dump(ours))
    environment = testbed.environment
    environment["AMENT_PREFIX_PATH"] = f"{prefix}:{environment['AMENT_PREFIX_PATH']}"
    environment["PATH"] = f"{place / 'bin'}:{environment['PATH']}"
    started = place / "started"
    command = [sys.executable, "-c", PROGRAM, str(place / "panda.launch.xml")]
    with (
        (testbed.folder / "launch.log").open("w") as log,
        subprocess.Popen(command, env=environment, cwd=place, stdout=log, stderr=log) as launched,
    ):
        testbed.spin_until(lambda: started.exists() and "spawner" in started.read_text(), "the spawner")
        plant.switch(True)
        rig.follow()
        launched.send_signal(signal.SIGINT)
        assert launched.wait(DEADLINE) == 0, (testbed.folder / "launch.log").read_text()
    lines = {line.split()[0]: line for line in started.read_text().splitlines()}
    assert "-f 45" in lines["chrt"]
    assert "ros2_controllers.yaml" in lines["ros2_control_node"]
    assert steps(plant.efforts) < STEP, "from the first torque on"
    assert farthest(plant.positions) < STILL


def test_goals_within_the_limits_of_the_arm_are_followed_and_others_refused(make_rig: Any) -> None:
    rig: Rig = make_rig()
    rig.plant.switch(True)
    rig.start()
    rig.follow()
    accepted, code, text = rig.outcome(0.05)
    assert (accepted, code) == (True, Result.SUCCESSFUL), f"{text}\n{rig.running['controller'].tail()}"
    assert farthest(rig.plant.positions) > 0.04
    accepted, code, _ = rig.outcome(BEYOND)
    assert not accepted or code == Result.INVALID_GOAL


@pytest.mark.parametrize(
    ("noise", "cause"),
    [(0.0, "the torque has no effect on"), (1e-5, "is beyond limits.tracking_error")],
    ids=["encoders that rest", "encoders with noise"],
)
def test_an_effort_controller_that_is_switched_off_is_named_and_returns_without_a_jump(
    make_rig: Any, noise: float, cause: str
) -> None:
    """Before the manager reports it, what the law winds up to is bounded, though the reference moves."""
    rig: Rig = make_rig()
    plant = rig.plant
    plant.noise = noise
    plant.switch(True)
    rig.start()
    rig.follow()
    rig.next_report()
    before = plant.efforts[-1]
    plant.ended = lambda: rig.says("controller", "deactivated, because no torque reaches the arm")
    plant.switch(False)
    plant.silent = True
    rig.send(0.3)
    plant.go_on(20.0, lambda: rig.says("controller", cause))  # Planning takes as long as the machine needs.
    assert rig.says("controller", cause)
    plant.silent = False
    plant.go_on(20.0, plant.ended)
    assert plant.ended()
    assert largest(plant.commands) < 0.7 * EFFORT

    assert not rig.change(Transition.TRANSITION_ACTIVATE)
    assert rig.says("controller", "not activated: controller_manager reports that effort_controller is inactive")
    plant.switch(True)
    again = len(plant.efforts)
    plant.go_on(0.3)
    np.testing.assert_allclose(plant.efforts[again], before, atol=STEP)
    assert steps(plant.efforts[again:]) == 0.0
    assert farthest(plant.positions) < STILL


def test_what_zeroes_its_torque_drops_the_arm_until_the_next_command(make_rig: Any) -> None:
    """JointGroupEffortController, as the page warns."""
    plant = make_rig(zeroes=True).plant
    plant.switch(True)
    plant.controller.told = plant.arm.qfrc_bias.copy()
    plant.go_on(0.1)
    assert farthest(plant.positions) < STILL
    plant.switch(False)
    plant.switch(True)
    plant.go_on(0.2)
    assert not plant.efforts[-1].any()
    assert farthest(plant.positions) > 10 * STILL


def test_an_arm_that_has_fallen_silent_behind_topic_based_hardware_is_named(make_rig: Any) -> None:
    """Its last position returns with new stamps."""
    rig: Rig = make_rig()
    plant = rig.plant
    plant.switch(True)
    rig.start()
    rig.follow()
    plant.dead = True
    died = len(plant.commands)
    rig.send(0.3)
    plant.go_on(20.0, lambda: rig.says("controller", "no effect"))
    assert rig.says("controller", "stopped: the torque has no effect on panda_joint")
    assert largest(np.array(plant.commands[died:]) - plant.commands[died]) < 0.6 * EFFORT
