"""What leaves us is read by everyone: other libraries read our bags alike, and our commands read everyone's bags."""

import json
import re
import signal
import subprocess
import sys
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.spatial.transform import Rotation
from support import strangersrecorder
from support.judges import get_message, judged, messages
from support.strangersplant import StrangersPlant, start
from support.testbed import open_testbed

from pidtsm_core.experiment import PRACTICAL_FILE, Experiment, make_experiment
from pidtsm_core.identification.excitation import excitation
from pidtsm_core.parameters.files import load_ros_parameters
from pidtsm_core.robots import find_description
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Signal
from pidtsm_core.trajectories.limits import motion_limits
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.cli import main
from pidtsm_experiments.runs import runner
from pidtsm_experiments.runs.runner import Process, run
from pidtsm_msgs.msg import ControllerState
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.stamps import nanoseconds

LOOP = ("simulator/ground_truth", "controller/state", "joint_commands", "reference", "joint_states")
CONTACTS = "simulator/contact/"
WALL = '<mujoco><worldbody><geom name="wall" type="box" size="0.05 1 1" pos="0.44 0 0.5"/></worldbody></mujoco>'
"""Touched from the first sample on."""


class Run(NamedTuple):
    """How a run is made.

    Attributes:
        robot, clock: names.
        composed: whether its nodes share a process.
        memory: value of the bytes of allocated memory that nobody has written, both Python's and of libraries; "": any.
    """

    robot: str
    clock: str
    composed: bool
    memory: str = ""


RUNS = {
    "lockstep": Run("panda", "lockstep", composed=False, memory="165"),
    "composed": Run("panda", "lockstep", composed=True, memory="90"),
    "two": Run("two_link", "lockstep", composed=False),
    "realtime": Run("two_link", "realtime", composed=False),
    "composed_realtime": Run("panda", "realtime", composed=True),
}
DURATION = 0.3  # s


def experiment_of(name: str, folder: Path) -> Experiment:
    """The Panda touches a wall, on MuJoCo."""
    words, duration = ["simulator.encoder.bits=14"], DURATION
    if RUNS[name].clock == "realtime":
        words, duration = [*words, "simulator.rate=400"], 2.5 * DURATION
    if RUNS[name].robot == "panda":
        (folder / "wall.xml").write_text(WALL, encoding="utf-8")
        words += ["simulator.engine=mujoco", f"simulator.scene={folder / 'wall.xml'}"]
    return make_experiment(None, None, duration, ["practical"], words, robot=RUNS[name].robot)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("judges")


@pytest.fixture(scope="module")
def bags(folder: Path) -> dict[str, Path]:
    """Bags of our own nodes and of a rollout."""
    found = {}
    for name, (_, clock, composed, memory) in RUNS.items():
        (folder / name).mkdir()
        with pytest.MonkeyPatch.context() as patch:
            if memory:
                # A process that is forked would not read them.
                patch.setattr(runner, "Process", Process)
                patch.setenv("MALLOC_PERTURB_", memory)
                patch.setenv("PYTHONMALLOC", "malloc")
            found[name] = run(experiment_of(name, folder), clock, folder / name, lambda time: None, composed)
    assert main(["rollout", "--duration", "0.1", "--bag", "--out", str(folder / "rollout")]) in (0, 1)
    return {**found, "rollout": folder / "rollout/bag"}


@pytest.mark.parametrize("name", [*RUNS, "rollout"])
def test_three_libraries_read_the_same_numbers_from_every_message(bags: dict[str, Path], name: str) -> None:
    counts = judged(bags[name])
    assert set(LOOP) - ({"joint_states"} if name == "rollout" else set()) <= set(counts)
    assert min(counts[topic] for topic in LOOP if topic in counts) >= 100
    if name != "rollout":
        touched = sum(count for topic, count in counts.items() if topic.startswith(CONTACTS))
        assert (touched > 20) == (RUNS[name].robot == "panda")


def test_viewers_see_what_the_nodes_did(bags: dict[str, Path], folder: Path) -> None:
    """The file for Foxglove and RViz: every message as it was recorded, and frames where MuJoCo has the links."""
    (source,), file = bags["composed"].glob("*.mcap"), folder / "played.mcap"
    assert main(["export", str(bags["composed"]), "--foxglove", "--out", str(file)]) == 0
    found: list[Counter[tuple[str, int, bytes]]] = []
    for each in (source, file):
        with each.open("rb") as stream:
            found.append(Counter((c.topic, m.log_time, m.data) for _, c, m in make_reader(stream).iter_messages()))
    assert found[0] <= found[1]

    poses: dict[str, tuple[str, Any]] = {}
    truth: dict[int, Any] = {}
    with file.open("rb") as stream:
        for _, channel, _, message in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            if channel.topic in ("/tf", "/tf_static"):
                frames = {frame.child_frame_id: frame for frame in message.transforms}
                poses |= {name: (frame.header.frame_id, frame) for name, frame in frames.items()}
            elif channel.topic == "/robot_description":
                text = message.data
            elif channel.topic == "/simulator/ground_truth":
                truth[nanoseconds(message.header.stamp)] = dict(zip(message.name, message.position, strict=True))
    plain = '<mujoco><compiler fusestatic="false" discardvisual="true"/></mujoco></robot>'
    model = mujoco.MjModel.from_xml_string(text.replace("</robot>", plain))
    data = mujoco.MjData(model)
    for joint, q in truth[nanoseconds(poses["panda_link7"][1].header.stamp)].items():
        data.qpos[model.joint(joint).qposadr[0]] = q
    mujoco.mj_kinematics(model, data)
    for body in range(1, model.nbody):
        name, place = model.body(body).name, np.zeros(3)
        while name in poses:
            name, frame = poses[name]
            turn, way = frame.transform.rotation, frame.transform.translation
            place = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).apply(place) + np.array([way.x, way.y, way.z])
        np.testing.assert_allclose(place, data.xpos[body], rtol=0.0, atol=1e-9)


MEASURED = ("period", "rate", "period_jitter", "state_age", "missed_deadlines", "compute_time")
"""What the controller measures of itself, at the end of its state."""


def every_byte(bag: Path) -> dict[str, dict[int, set[bytes]]]:
    """The messages of each topic by stamp (ns), but for ``/diagnostics``, which have wall times, and `MEASURED`."""
    found: dict[str, dict[int, set[bytes]]] = defaultdict(lambda: defaultdict(set))
    for topic, _, data, *_ in messages(bag):
        exempt = 8 * len(MEASURED) if topic == "/controller/state" else 0
        if topic != "/diagnostics":
            found[topic.lstrip("/")][serialized_nanoseconds(data)].add(data[: len(data) - exempt])
    return found


def test_two_runs_in_lockstep_give_the_same_bytes_whatever_is_in_the_memory(bags: dict[str, Path]) -> None:
    """Nothing leaves that was not written: all memory has been filled, with different bytes, before it was used."""
    assert tuple(ControllerState.get_fields_and_field_types())[-len(MEASURED) :] == MEASURED
    first, second = (every_byte(bags[name]) for name in ("lockstep", "composed"))
    assert first.keys() == second.keys() == {*LOOP, f"{CONTACTS}panda_link6", f"{CONTACTS}panda_link7"}
    for topic in first:
        stamps = first[topic].keys() | second[topic].keys()
        assert [stamp for stamp in sorted(stamps) if first[topic].get(stamp) != second[topic].get(stamp)] == [], topic
    assert all(len(first[topic]) == 300 for topic in LOOP)


def test_rosbags_alone_reads_the_numbers_of_the_rollout(bags: dict[str, Path], folder: Path) -> None:
    expected = rollout(experiment_of("lockstep", folder))
    signals = {signal.name.lower(): expected.signals[:, signal] for signal in Signal}
    of_topic = {
        "simulator/ground_truth": {n: getattr(expected, n) for n in ("position", "velocity", "effort")},
        "controller/state": signals,
        "joint_commands": {"effort": signals["effort"]},
        "reference": dict(
            zip(("position", "velocity", "acceleration"), expected.reference.swapaxes(0, 1), strict=True)
        ),
        # The drives' estimates have no rollout.
        "joint_states": {},
    }
    read = 0
    for topic, _, data, message, _ in messages(bags["lockstep"]):
        sample = serialized_nanoseconds(data) // 1_000_000
        for field, values in of_topic.get(topic.lstrip("/"), {}).items():
            assert tuple(message.name) == expected.joints
            assert getattr(message, field).tobytes() == values[sample].tobytes(), (topic, field, sample)
            read += 1
    assert read >= 300 * sum(map(len, of_topic.values()))


@pytest.mark.parametrize("name", RUNS)
def test_commands_are_those_of_the_state(bags: dict[str, Path], name: str) -> None:
    """Two messages of one moment; where commands follow that answer no joint state, the first is meant."""
    efforts: dict[str, dict[int, bytes]] = defaultdict(dict)
    for topic, _, data, message, _ in messages(bags[name]):
        if topic in ("/controller/state", "/joint_commands"):
            efforts[topic].setdefault(serialized_nanoseconds(data), message.effort.tobytes())
    state, commands = efforts["/controller/state"], efforts["/joint_commands"]
    both = state.keys() & commands.keys()
    assert len(both) >= 100
    assert [stamp for stamp in both if state[stamp] != commands[stamp]] == []


@pytest.mark.parametrize("name", ["lockstep", "two"])
def test_joint_states_have_the_estimates_of_the_drives(bags: dict[str, Path], name: str) -> None:
    states: dict[int, Any] = {}
    truth: dict[int, Any] = {}
    for topic, kind, data, *_ in messages(bags[name]):
        if topic.endswith(("joint_states", "ground_truth")):
            found = states if topic.endswith("joint_states") else truth
            found[serialized_nanoseconds(data)] = deserialize_message(data, get_message(kind))
    assert truth.keys() <= states.keys()
    both = sorted(truth)
    assert len(both) >= 290
    measured, reported, true_position, true = (
        np.array([getattr(those[stamp], field) for stamp in both])
        for field, those in zip(["position", "velocity"] * 2, (states, states, truth, truth), strict=True)
    )
    # Encoders of 14 bits, low-passed with 600 rad/s.
    assert 0.0 < np.abs(measured - true_position).max() <= np.pi / 2**14 + 1e-12
    assert 0.0 < np.abs(reported - true)[20:].max() < 0.4
    assert [list(states[stamp].effort) for stamp in both[1:]] == [list(truth[stamp].effort) for stamp in both[:-1]]


@pytest.mark.parametrize("name", ["two", "realtime"])
def test_without_the_ground_truth_a_run_is_judged_by_what_was_measured(
    bags: dict[str, Path], name: str, tmp_path: Path
) -> None:
    """Of the loop only what an arm and a controller of somebody else's have: joint states, references, commands."""
    copy(bags[name], tmp_path / "bag")
    measured, true = read_recording(tmp_path / "bag"), read_recording(bags[name])
    assert measured.truth == "joint_states (measured), no ground truth in the bag"
    assert measured.lacking == ("controller/state",)
    joint, at, of = np.intersect1d(measured.stamps_ns, true.stamps_ns, return_indices=True)
    assert joint.size >= 200
    encoder = 2.0 * np.pi / 2**14
    assert np.abs(measured.error[at] - true.error[of]).max() <= encoder
    np.testing.assert_array_equal(measured.effort[at][:-1], true.effort[of][:-1])
    np.testing.assert_array_equal(measured.commanded_effort[at], true.commanded_effort[of])


# A plant and recorders of somebody else's.

REAL_ARM = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/reference": "pidtsm_msgs/msg/JointReference",
    "/joint_commands": "sensor_msgs/msg/JointState",
}
MOVING = 7.0  # s


def copy(bag: Path, folder: Path) -> None:
    """What a bag of a real arm has, as rosbags writes it in SQLite."""
    store = typestore()
    with AnyReader([bag]) as reader, Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections = [each for each in reader.connections if each.topic in REAL_ARM]
        of = {c.topic: writer.add_connection(c.topic, c.msgtype, typestore=store) for c in connections}
        for connection, time, data in reader.messages(connections):
            writer.write(of[connection.topic], time, data)


class EncodedPlant(StrangersPlant):
    """The arm with encoders of 14 bits; `read`: what they read, rad."""

    KEPT = 4000

    def publish(self, stamp: int, q: Any) -> None:
        self.read = [*getattr(self, "read", []), np.round(q * 2**14 / (2.0 * np.pi)) * (2.0 * np.pi / 2**14)]
        super().publish(stamp, self.read[-1])


class Strangers(NamedTuple):
    """A plant of the test's own that has moved, and what three recorders made of it."""

    plant: EncodedPlant
    bags: dict[str, Path]


@pytest.fixture(scope="module")
def strangers(tmp_path_factory: pytest.TempPathFactory) -> Strangers:
    """At 500 Hz, on a motion that shows the arm's parameters, under our controller."""
    folder = tmp_path_factory.mktemp("strangers")
    two_link = {"robot.description": "two_link"}
    motion = excitation(find_description(two_link), motion_limits(two_link), MOVING, MOVING)
    header = ",".join(["time", *(f"{kind}_{joint}" for kind in ("q", "dq", "ddq") for joint in motion.joints)])
    table = np.column_stack([motion.time, *motion.motion])
    np.savetxt(folder / "motion.csv", table, delimiter=",", header=header, comments="")
    with open_testbed(folder) as testbed:
        plant = EncodedPlant(testbed, 500)
        plant.q = motion.motion[0, 0].copy()
        words = [str(folder), *(f"{topic}={kind}" for topic, kind in REAL_ARM.items())]
        ours = testbed.start("recorder", f"output:={folder / 'recorder'}")
        with subprocess.Popen([sys.executable, strangersrecorder.__file__, *words], env=testbed.environment) as theirs:
            try:
                csv = {"reference.name": "csv", "reference.file": folder / "motion.csv"}
                start(testbed, plant, 3, **csv, **load_ros_parameters(PRACTICAL_FILE)["controller"])
                plant.go_on(MOVING)
                ours.interrupt()
                theirs.send_signal(signal.SIGINT)
                assert ours.wait() == 0, ours.tail()
                assert theirs.wait(60.0) == 0
            finally:
                theirs.kill()
        assert "recording without /simulator/ground_truth" in ours.tail()
        samples = len(plant.times)
        counted = f"{samples} of controller/state, {samples} of joint_commands, {samples} of reference"
        assert f"received {counted}, {samples} of joint_states, " in ours.tail()
        assert re.search(r", [1-9]\d* of diagnostics; nothing of simulator/ground_truth", ours.tail())
    bags = {"recorder": folder / "recorder", "mcap": folder / "mcap.mcap", "sqlite": folder / "sqlite"}
    return Strangers(plant, bags)


WRITERS = ("recorder", "mcap", "sqlite")


@pytest.mark.parametrize("writer", WRITERS)
def test_each_recorder_has_every_message_of_a_strangers_plant(strangers: Strangers, writer: str) -> None:
    plant = strangers.plant
    found: dict[str, list[Any]] = defaultdict(list)
    with AnyReader([strangers.bags[writer]], default_typestore=typestore()) as reader:
        for connection, _, data in reader.messages([c for c in reader.connections if c.topic in REAL_ARM]):
            found[connection.topic].append(reader.deserialize(data, connection.msgtype))
    assert {topic: len(each) for topic, each in found.items()} == dict.fromkeys(REAL_ARM, len(plant.times))
    for topic, field, expected in (
        ("/joint_states", "position", plant.read),
        ("/joint_commands", "effort", plant.efforts),
    ):
        for message, values in zip(found[topic], expected, strict=True):
            by_name = dict(zip(message.name, getattr(message, field), strict=True))
            assert [by_name["joint1"], by_name["joint2"]] == list(values)


@pytest.mark.parametrize("writer", WRITERS)
def test_a_strangers_plant_is_analysed_and_identified(
    strangers: Strangers, writer: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plant, bag = strangers.plant, str(strangers.bags[writer])
    assert main(["analyze", bag, "--json"]) == 0
    metrics = json.loads(capsys.readouterr().out)
    assert (
        metrics["truth"] == "joint_states (measured), efforts as commanded (joint_commands), no ground truth in the bag"
    )
    assert metrics["lacking"] == ([] if writer == "recorder" else ["controller/state"])
    assert metrics["samples"] == len(plant.times)
    desired = [[dict(zip(m.name, m.position, strict=True))[j] for j in ("joint1", "joint2")] for m in plant.references]
    error = dict(
        zip(("joint1", "joint2"), np.sqrt(np.mean(np.subtract(plant.read, desired) ** 2, axis=0)), strict=True)
    )
    assert metrics["rmse"] == pytest.approx([error[joint] for joint in metrics["joints"]], rel=1e-9)
    assert main(["analyze", bag]) == 0
    assert "no ground truth in the bag" in " ".join(capsys.readouterr().out.split())
    assert main(["identify", bag, "--robot", "two_link", "--out", str(tmp_path), "--json"]) == 0
    printed = capsys.readouterr()
    assert "joint_commands, efforts as commanded" in printed.err
    found = json.loads(printed.out)
    # What `strangersplant` has, and the description lacks.
    assert found["armature"] == pytest.approx([5.0, 5.0], rel=0.01)
    assert found["viscous"] == pytest.approx([0.5, 0.5], rel=0.1)
    assert found["coulomb"] == pytest.approx([0.5, 0.5], rel=0.1)
    assert main(["identify-payload", bag, "--robot", str(tmp_path / "identified.urdf"), "--json"]) == 0
    assert abs(json.loads(capsys.readouterr().out)["mass"]) < 0.01


def test_a_strangers_recordings_are_compared_and_reported(
    strangers: Strangers, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "compare"
    assert main(["compare", *map(str, strangers.bags.values()), "--out", str(out), "--json"]) == 0
    compared = json.loads(capsys.readouterr().out)
    assert len(compared["runs"]) == 3
    for joints in compared["differences"].values():
        assert joints["rmse"] == [0.0, 0.0]
    for name, bag in strangers.bags.items():
        assert main(["report", str(bag), "--out", str(tmp_path / name)]) == 0
        assert "no ground truth in the bag" in (tmp_path / name / "report.html").read_text(encoding="utf-8")
