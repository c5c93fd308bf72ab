"""``./pidtsm nodes`` and ``replay-motion`` on real nodes, judged by a node of the test's and readers of others."""

import json
import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from sensor_msgs.msg import JointState
from support.judges import judged, opened
from support.nursery import forked_command
from support.strangersplant import STRANGERS_ORDER, StrangersPlant, in_order
from support.testbed import Testbed, open_testbed

from pidtsm_core.signals import Mode
from pidtsm_experiments.cli import main
from pidtsm_msgs.msg import ControllerState
from pidtsm_ros.qos import READER

DEADLINE = 180.0
"""s; only a failing test waits that long."""
SPACE = "left"


class Command:
    """A ``./pidtsm`` command that runs until it is interrupted."""

    def __init__(self, testbed: Testbed, *words: str) -> None:
        self.testbed = testbed
        self._log = testbed.folder / f"{'-'.join(words[:2])}.log"
        self.process = forked_command(words, testbed.folder, testbed.environment, self._log)

    @property
    def said(self) -> str:
        return self._log.read_text()

    def until(self, condition: Callable[[], Any], what: str, meanwhile: Callable[[], Any] = lambda: None) -> None:
        """Wait for a condition while the command runs."""
        end = time.monotonic() + DEADLINE
        while not condition():
            assert self.process.poll() is None, self.said
            assert time.monotonic() < end, f"not within {DEADLINE:g} s: {what}\n{self.said}"
            meanwhile()
            self.testbed.executor.spin_once(timeout_sec=0.001)

    def until_said(self, text: str, meanwhile: Callable[[], Any] = lambda: None) -> None:
        self.until(lambda: text in self.said, text, meanwhile)

    def interrupt(self, meanwhile: Callable[[], Any] = lambda: None) -> int:
        self.process.send_signal(signal.SIGINT)
        end = time.monotonic() + DEADLINE
        while (code := self.process.poll()) is None:
            assert time.monotonic() < end, self.said
            meanwhile()
            self.testbed.executor.spin_once(timeout_sec=0.001)
        return code

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        self.process.wait(DEADLINE)


class System(NamedTuple):
    """A system that ``nodes start`` has started, and what the test hears of it."""

    testbed: Testbed
    started: Command
    states: list[ControllerState]

    def until_mode(self, mode: Mode) -> None:
        self.states.clear()
        self.testbed.spin_until(lambda: self.states and self.states[-1].mode == mode, f"the mode {mode.name}")

    def parameter(self, node: str, name: str) -> Any:
        request = GetParameters.Request(names=[name])
        answer = self.testbed.call(GetParameters, f"/{SPACE}/{node}/get_parameters", request)
        return parameter_value_to_python(answer.values[0])


@contextmanager
def started(testbed: Testbed, *words: str) -> Iterator[Command]:
    command = Command(testbed, "nodes", "start", *words)
    try:
        yield command
    finally:
        command.end()


@contextmanager
def in_domain_of(testbed: Testbed) -> Iterator[None]:
    """The commands of this process join the domain of a testbed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", testbed.environment["ROS_DOMAIN_ID"])
        yield


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    with (
        open_testbed(tmp_path_factory.mktemp("nodes")) as testbed,
        in_domain_of(testbed),
        started(
            testbed, "--plant", "--namespace", SPACE, "--scenario", "case1", "--set", "simulator.rate=250"
        ) as command,
    ):
        states: list[ControllerState] = testbed.hear(ControllerState, f"/{SPACE}/controller/state", READER)
        command.until_said("Following the reference")
        yield System(testbed, command, states)


def of_system(*words: str) -> int:
    return main(["nodes", *words, "--namespace", SPACE])


def test_the_list_has_what_the_nodes_say(system: System, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["nodes", "list", "--json"]) == 0
    rows = {row["node"]: row for row in json.loads(capfd.readouterr().out)}
    assert set(rows) == {f"/{SPACE}/{node}" for node in ("controller", "trajectory", "simulator")}
    for node, row in rows.items():
        answer = system.testbed.call(GetState, f"{node}/get_state", GetState.Request())
        assert row["lifecycle"] == answer.current_state.label == "active"
        assert row["age"] is None or row["age"] < DEADLINE
    controller = rows[f"/{SPACE}/controller"]
    assert (controller["mode"], controller["fault"]) == ("following", "")
    assert main(["nodes", "list"]) == 0
    assert "Following the reference" in " ".join(capfd.readouterr().out.split())
    assert main(["nodes", "list", "--namespace", "nobody", "--json"]) == 1
    nothing = capfd.readouterr()
    assert json.loads(nothing.out) == []
    assert "namespace /nobody" in nothing.err


def test_parameters_are_set_together_or_not_at_all(system: System, capfd: pytest.CaptureFixture[str]) -> None:
    assert of_system("param", "set", "controller", "law.k1=3.5,2.5", "law.kd=0.6") == 0
    assert list(system.parameter("controller", "law.k1")) == [3.5, 2.5]
    assert system.parameter("controller", "law.kd") == 0.6
    capfd.readouterr()
    assert of_system("param", "set", "controller", "law.kd=0.7", "law.k1=-1") == 1
    assert "law.k1: -1 must be >= 0" in capfd.readouterr().err
    assert system.parameter("controller", "law.kd") == 0.6
    assert main(["nodes", "param", "get", f"/{SPACE}/controller", "law.k1"]) == 0
    assert capfd.readouterr().out == "3.5, 2.5\n"
    assert of_system("param", "get", "controller", "law.kk1") == 1
    assert "did you mean" in capfd.readouterr().err
    assert of_system("param", "list", "trajectory", "limits.", "--json") == 0
    listed = json.loads(capfd.readouterr().out)
    assert listed["limits.effort"] == list(system.parameter("trajectory", "limits.effort"))
    assert all(name.startswith("limits.") for name in listed)


def test_freedrive_hold_and_back(system: System, capfd: pytest.CaptureFixture[str]) -> None:
    assert of_system("freedrive", "on") == 0
    system.until_mode(Mode.FREEDRIVE)
    system.started.until_said("Freedrive: the arm can be moved by hand")
    assert of_system("freedrive", "off") == 0
    system.until_mode(Mode.HOLDING)
    system.started.until_said("Holding its position on request")
    capfd.readouterr()
    assert of_system("list", "--json") == 0
    rows = {row["node"]: row for row in json.loads(capfd.readouterr().out)}
    assert rows[f"/{SPACE}/controller"]["status"] == "Holding its position on request"
    assert of_system("hold", "off") == 0
    system.until_mode(Mode.FOLLOWING)


def test_a_fault_is_named_and_reset(system: System, capfd: pytest.CaptureFixture[str]) -> None:
    assert of_system("reset") == 1
    assert "there is no fault" in capfd.readouterr().err
    assert (
        of_system("param", "set", "controller", "limits.tracking_error_action=stop", "limits.tracking_error=1e-9") == 0
    )
    system.until_mode(Mode.STOPPED)
    system.started.until_said("Stopped: joint")
    capfd.readouterr()
    assert of_system("list", "--json") == 0
    rows = {row["node"]: row for row in json.loads(capfd.readouterr().out)}
    assert rows[f"/{SPACE}/controller"]["mode"] == "stopped"
    assert "limits.tracking_error" in rows[f"/{SPACE}/controller"]["fault"]
    assert of_system("freedrive", "on") == 1
    assert "there is a fault" in capfd.readouterr().err
    assert of_system("param", "set", "controller", "limits.tracking_error", "0") == 0
    assert of_system("reset") == 0
    system.until_mode(Mode.FOLLOWING)


@pytest.fixture(scope="module")
def bag(system: System) -> Path:
    """What ``nodes record`` has recorded until Ctrl-C."""
    recording = Command(system.testbed, "nodes", "record", "--namespace", SPACE, "--output", "taught", "--json")
    path = system.testbed.folder / "taught"

    def grown() -> bool:
        files = [*path.glob("*.mcap")] if path.is_dir() else []
        return sum(file.stat().st_size for file in files) > 500_000

    try:
        recording.until(grown, "half a megabyte")
        assert recording.interrupt() == 0, recording.said
    finally:
        recording.end()
    told = json.loads(recording.said.splitlines()[-1])
    assert Path(told["bag"]).name == "taught"
    assert told["samples"] > 100
    assert told["size"] == sum(file.stat().st_size for file in path.iterdir())
    return path


def positions(bag: Path) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Of joint1 and joint2 in every joint state, as rosbags reads them."""
    with opened(bag) as (reader, _):
        wanted = [connection for connection in reader.connections if connection.topic == "/joint_states"]
        decoded: list[Any] = [reader.deserialize(data, each.msgtype) for each, _, data in reader.messages(wanted)]
        return np.array([in_order(message, message.position) for message in decoded])


def test_a_recording_is_whole_and_exists_once(system: System, bag: Path, capfd: pytest.CaptureFixture[str]) -> None:
    counts = judged(bag)
    assert min(counts[topic] for topic in ("joint_states", "joint_commands", "reference", "controller/state")) > 100
    assert of_system("record", "--output", str(bag)) == 2
    assert "exists" in capfd.readouterr().err


def test_a_motion_is_checked_and_repeated(system: System, bag: Path, capfd: pytest.CaptureFixture[str]) -> None:
    recorded = positions(bag)
    assert main(["replay-motion", str(bag), "--dry-run", "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    smallest, largest = ([joint[key] for joint in told["joints"]] for key in ("smallest", "largest"))
    np.testing.assert_allclose([smallest, largest], [recorded.min(axis=0), recorded.max(axis=0)], atol=2e-3)
    assert main(["replay-motion", str(bag), "--dry-run", "--robot", "panda"]) == 2
    assert "the bag lacks panda_joint1" in capfd.readouterr().err
    assert main(["replay-motion", str(bag), "--namespace", SPACE, "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["duration"] > 0.5
    system.until_mode(Mode.FOLLOWING)

    def arrived() -> bool:
        newest = system.states[-1]
        return bool(np.abs(np.array(in_order(newest, newest.position)) - recorded[-1]).max() < 0.01)

    system.testbed.spin_until(arrived, "the last posture of the recording")


def test_a_demonstration_becomes_a_dataset_and_returns_to_the_arm(
    system: System, bag: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is optional (requirements/parquet.lock)")
    recorded, dataset = positions(bag), str(tmp_path / "demonstrations")
    words = ["--format", "lerobot", "--out", dataset, "--fps", "50", "--episodes", str(bag)]
    assert main(["export", str(bag), *words]) == 0
    assert "2 episodes" in capfd.readouterr().err
    desired = str(tmp_path / "teleoperation")
    assert main(["export", str(bag), "--format", "lerobot", "--out", desired, "--actions", "reference"]) == 0
    frames = parquet.read_table(Path(desired) / "data").to_pydict()
    state, action = np.array(frames["observation.state"]), np.array(frames["action"])
    assert 0.0 < np.abs(action - state).max() < 0.1
    assert not np.array_equal(action[:-1], state[1:])
    elsewhere = [f"{q + 0.2:.3f}" for q in recorded[-1]]
    assert main(["move", "--to", *elsewhere, "--namespace", SPACE, "--json"]) == 0
    capfd.readouterr()
    assert main(["replay-motion", dataset, "--episode", "1", "--namespace", SPACE, "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["duration"] > 0.5

    def arrived() -> bool:
        newest = system.states[-1]
        return bool(np.abs(np.array(in_order(newest, newest.position)) - recorded[-1]).max() < 0.01)

    system.testbed.spin_until(arrived, "the last posture of the demonstration")


def test_a_motion_beyond_a_limit_is_refused_before_it_begins(
    bag: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "slow.urdf"
    model.write_text(SLOW)
    assert main(["replay-motion", str(bag), "--dry-run", "--robot", str(model)]) == 1
    refused = capfd.readouterr().err
    assert "at most 0.00095 is allowed" in refused
    factor = re.search(r"--speed (\S+)", refused)
    assert factor
    assert main(["replay-motion", str(bag), "--dry-run", "--robot", str(model), "--speed", factor[1]]) == 0


LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial></link>"
)
JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 1 0"/>'
    '<limit lower="-3" upper="3" effort="100" velocity="0.001"/></joint>'
)
SLOW = (
    '<robot name="slow"><link name="base"/>'
    + LINK.format("upper")
    + LINK.format("lower")
    + JOINT.format("joint1", "base", "upper")
    + JOINT.format("joint2", "upper", "lower")
    + "</robot>"
)


def test_stop_ends_what_start_has_started(system: System, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["nodes", "start", "--plant", "--namespace", SPACE]) == 2
    assert "are started already" in capfd.readouterr().err
    assert main(["nodes", "stop", "--namespace", "nobody"]) == 1
    assert f"there is one in namespace /{SPACE}" in capfd.readouterr().err
    assert of_system("stop") == 0
    assert system.started.process.wait(DEADLINE) == 0
    said = system.started.said
    assert "bringing the arm to rest" in said
    assert said.rstrip().endswith("ended")
    assert "Traceback" not in said


def test_detached_nodes_go_on_until_they_are_stopped(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with open_testbed(tmp_path) as testbed, in_domain_of(testbed):
        try:
            started = Command(testbed, "nodes", "start", "--detach")
            assert started.process.wait(DEADLINE) == 0
            assert "waiting for joint_states of joint1, joint2 on /joint_states" in started.said
            again = Command(testbed, "nodes", "start", "--detach")
            assert again.process.wait(DEADLINE) == 2
            assert "are started already" in again.said
        finally:
            assert main(["nodes", "stop"]) == 0
        (first, _) = sorted(tmp_path.glob("results/nodes/*.log"))
        assert first.read_text().rstrip().endswith("ended")
        assert "ended the nodes in ROS domain" in capfd.readouterr().out


class RealTimePlant(StrangersPlant):
    """It moves with the time of the wall, under the newest command; its brakes are closed before the first."""

    def __init__(self, testbed: Testbed) -> None:
        super().__init__(testbed, rate=200)
        self.next = time.monotonic()

    def live(self) -> None:
        """Do what is due."""
        while time.monotonic() >= self.next:
            if self.answers:
                self.integrate(in_order(self.answers[-1], self.answers[-1].effort), self.period)
            self.next += self.period
            self.publish(time.time_ns(), self.q)


def test_a_real_arm_stays_where_it_is_and_is_carried_at_the_end(tmp_path: Path) -> None:
    with (
        open_testbed(tmp_path) as testbed,
        started(
            testbed, "--set", "controller.watchdog.state_stop=5.0", "--remap", "joint_states:=/arm/states"
        ) as command,
    ):
        command.until_said("waiting for joint_states of joint1, joint2 on /arm/states")
        plant = RealTimePlant(testbed)
        plant.states = testbed.node.create_publisher(JointState, "/arm/states", 10)
        command.until_said("first joint_states: joint1 0.3900, joint2 -0.0100", plant.live)
        command.until_said("Following the reference", plant.live)
        end = time.monotonic() + 2.0
        command.until(lambda: time.monotonic() > end, "two seconds", plant.live)
        assert np.abs(plant.q - [0.39, -0.01]).max() < 0.02
        assert list(plant.answers[-1].name) == ["joint1", "joint2"] != STRANGERS_ORDER
        assert command.interrupt(plant.live) == 0
        assert command.said.rstrip().endswith("ended")
        # Its last torque carries it: 2 kg m and 1.275 kg m at 0.39 rad.
        last = in_order(plant.answers[-1], plant.answers[-1].effort)
        assert last[0] == pytest.approx(9.8 * (2.0 + 1.275) * np.cos(0.39), abs=3.0)


def test_without_a_controller_it_says_how_to_start_one(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with open_testbed(tmp_path) as testbed, in_domain_of(testbed):
        domain = testbed.environment["ROS_DOMAIN_ID"]
        assert main(["nodes", "hold", "on"]) == 1
        expected = f"no pidtsm controller in ROS domain {domain}; start one with ./pidtsm nodes start"
        assert expected in capfd.readouterr().err


@pytest.mark.parametrize(
    ("words", "cause"),
    [
        (["start", "--engine", "mujoco"], "--engine is for the simulated arm, which --plant starts"),
        (["start", "--set", "simulator.rate=500"], "--set simulator.rate=500 is for the simulated arm"),
        (["start", "--remap", "states"], "--remap states: must be of the form FROM:=TO"),
        (["start", "--robot", "nobody"], "nobody"),
        (["param", "set", "controller", "law.k1"], "give NAME VALUE, or NAME=VALUE"),
        (["param", "get", "/a/controller", "law.k1", "--namespace", "b"], "--namespace b is another one"),
        (["list", "--namespace", "a b"], "--namespace"),
        (["record", "--duration", "-1"], "not a positive number"),
    ],
)
def test_wrong_input_is_named(words: list[str], cause: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["nodes", *words]) == 2
    assert cause in capfd.readouterr().err
