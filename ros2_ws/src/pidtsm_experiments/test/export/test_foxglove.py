"""MCAP files for Foxglove and RViz, judged by the readers of mcap and rosbags, and by MuJoCo's kinematics."""

import os
import resource
import shutil
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2, QosDurability, QosReliability
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Recording
from pidtsm_core.robots.source import read_source
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.cli import main
from pidtsm_experiments.export.foxglove import write_foxglove
from pidtsm_experiments.runs.files import written_file

ARMS = ("panda", "scara")
TYPES = {
    "/tf": TFMessage,
    "/tf_static": TFMessage,
    "/robot_description": String,
    "/visualization/markers": MarkerArray,
}
ADDED = tuple(TYPES)
SOURCES = {"": "/simulator/ground_truth", "reference/": "/reference"}
"""Topic of the positions of each arm, by the prefix of its frames."""


@pytest.fixture(scope="session")
def played(bags: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the exported file of each arm; do not change it."""
    folder = tmp_path_factory.mktemp("played")
    for arm in ARMS:
        assert main(["export", str(bags / arm), "--foxglove", "--out", str(folder / f"{arm}.mcap")]) == 0
    return folder


def decoded(file: Path) -> dict[str, list[Any]]:
    """Messages by topic, read by mcap's own libraries; they check the checksums."""
    messages: dict[str, list[Any]] = defaultdict(list)
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            messages[channel.topic].append(message)
    return messages


def recorded(file: Path) -> list[tuple[str, str, bytes, int, bytes]]:
    """Topic, type, definition, time and bytes of every message that was not added."""
    with file.open("rb") as stream:
        return [
            (channel.topic, schema.name, schema.data, message.log_time, message.data)
            for schema, channel, message in make_reader(stream).iter_messages()
            if schema and channel.topic not in ADDED
        ]


@pytest.mark.parametrize("arm", ARMS)
def test_recorded_messages_are_unchanged(bags: Path, played: Path, arm: str) -> None:
    assert recorded(played / f"{arm}.mcap") == recorded(bags / arm / f"{arm}_0.mcap")
    assert read_recording(played / f"{arm}.mcap").metrics() == read_recording(bags / arm).metrics()


def nanoseconds(stamp: Any) -> int:
    return int(stamp.sec * 10**9 + stamp.nanosec)


def matrix(transform: Any) -> Array:
    turn, place = transform.rotation, transform.translation
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    pose[:3, 3] = place.x, place.y, place.z
    return pose


class Poses:
    """Frames of a file as a listener of tf combines them."""

    def __init__(self, messages: Mapping[str, list[Any]]) -> None:
        self.tree: dict[str, dict[int | None, tuple[str, Array]]] = defaultdict(dict)
        for topic in ("/tf", "/tf_static"):
            for frame in (frame for message in messages[topic] for frame in message.transforms):
                stamp = nanoseconds(frame.header.stamp) if topic == "/tf" else None
                self.tree[frame.child_frame_id][stamp] = frame.header.frame_id, matrix(frame.transform)

    def at(self, frame: str, stamp: int) -> Array:
        """From a frame to that of the base, shape (4, 4)."""
        pose = np.eye(4)
        while frame in self.tree:
            known = self.tree[frame]
            frame, step = known[stamp] if stamp in known else known[None]
            pose = step @ pose
        return pose


@pytest.mark.parametrize("arm", ARMS)
def test_all_links_are_where_mujoco_puts_them(played: Path, arm: str) -> None:
    messages = decoded(played / f"{arm}.mcap")
    text = messages["/robot_description"][0].data
    assert text == read_source(arm)[1]
    asked = '<mujoco><compiler fusestatic="false" discardvisual="true"/></mujoco></robot>'
    model = mujoco.MjModel.from_xml_string(text.replace("</robot>", asked))
    data, poses = mujoco.MjData(model), Poses(messages)
    positions = {
        prefix: {nanoseconds(m.header.stamp): dict(zip(m.name, m.position, strict=True)) for m in messages[topic]}
        for prefix, topic in SOURCES.items()
    }
    stamps = {nanoseconds(frame.header.stamp) for m in messages["/tf"] for frame in m.transforms}
    assert len(stamps) == 20, "100 a second"
    for stamp in stamps:
        for prefix, known in positions.items():
            for joint, q in known[stamp].items():
                data.qpos[model.joint(joint).qposadr[0]] = q
            mujoco.mj_kinematics(model, data)
            for body in range(1, model.nbody):
                pose = poses.at(prefix + model.body(body).name, stamp)
                np.testing.assert_allclose(pose[:3, 3], data.xpos[body], rtol=0.0, atol=1e-9)
                np.testing.assert_allclose(pose[:3, :3].ravel(), data.xmat[body], rtol=0.0, atol=1e-9)
    links = {model.body(body).name for body in range(1, model.nbody)}
    assert {prefix + link for prefix in SOURCES for link in links} <= poses.tree.keys()


def test_standard_types_and_latched_topics_are_what_rosbags_and_rclpy_expect(played: Path) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    with AnyReader([played / "panda.mcap"], default_typestore=store) as reader:
        added = {connection.topic: connection for connection in reader.connections if connection.topic in ADDED}
        for connection, _, data in reader.messages(list(added.values())):
            through = serialize_message(deserialize_message(data, TYPES[connection.topic]))[: len(data)]
            for each in (data, through):  # Bytes between the fields are rclpy's own.
                message = store.deserialize_cdr(each, connection.msgtype)
                assert bytes(store.serialize_cdr(message, connection.msgtype)) == data
    assert set(added) == set(ADDED)
    with (played / "panda.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary
    hashes = {channel.topic: channel.metadata["topic_type_hash"] for channel in summary.channels.values()}
    for topic, connection in added.items():
        assert hashes[topic] == store.hash_rihs01(connection.msgtype)
        assert isinstance(connection.ext, ConnectionExtRosbag2)
        (quality,) = connection.ext.offered_qos_profiles
        kept = topic in ("/tf_static", "/robot_description")
        assert quality.reliability is QosReliability.RELIABLE
        assert quality.durability is (QosDurability.TRANSIENT_LOCAL if kept else QosDurability.VOLATILE)


def test_markers_join_the_links(played: Path) -> None:
    messages = decoded(played / "scara.mcap")
    poses = Poses(messages)
    names = {"arm": "", "reference": "reference/"}
    for message in messages["/visualization/markers"]:
        (marker,) = message.markers
        origin = poses.at(f"{names[marker.ns]}link4", nanoseconds(marker.header.stamp))[:3, 3]
        ends = np.array([(point.x, point.y, point.z) for point in marker.points])
        assert np.abs(ends - origin).max(axis=1).min() < 1e-9
    assert {marker.ns for message in messages["/visualization/markers"] for marker in message.markers} == set(names)


@pytest.fixture
def strange(folder: Path) -> Path:
    """A bag of a two-link arm that no run has recorded, with a quality of service of its own."""
    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "sensor_msgs/msg/JointState"
    state, header, time = (store.types[name] for name in (kind, "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    with Writer(folder / "strange", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/joint_states", kind, typestore=store)
        for i in range(30):
            q = np.array([0.1, 0.2 * i]) if i else np.zeros(0)  # Drives that have not started.
            message = state(header(time(7, 10**7 * i), ""), ["joint2", "joint1"], q, np.zeros(0), np.zeros(0))
            writer.write(connection, i, store.serialize_cdr(message, kind))
    return folder / "strange"


def test_any_bag_with_joint_states_is_played_with_a_named_arm(
    strange: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", "strange", "--foxglove"]) == 2
    assert "--robot" in capsys.readouterr().err
    assert {path.name for path in folder.iterdir()} == {"strange"}
    assert main(["export", "strange", "--foxglove", "--robot", "two_link"]) == 0
    assert "no reference" in capsys.readouterr().err
    messages = decoded(folder / "strange_foxglove.mcap")
    assert len(messages["/joint_states"]) == 30
    assert len(messages["/tf"]) == 29
    assert not any(frame.child_frame_id.startswith("reference") for m in messages["/tf"] for frame in m.transforms)


@pytest.mark.parametrize(
    ("words", "cause"),
    [
        (["nothing", "--foxglove"], "nothing"),
        (["strange", "--foxglove", "--robot", "panda"], "panda_joint1"),
        (["strange", "--foxglove", "--rerun", "--out", "both"], "name one of them"),
        (["strange", "--csv", "a.csv", "--out", "b.mcap"], "--foxglove or --rerun"),
        (["strange", "--csv", "a.csv", "--robot", "panda"], "--foxglove and --rerun"),
        (["strange", "--foxglove", "--robot", "two_link", "--out", "strange/strange.db3"], "part of the bag"),
    ],
)
def test_what_is_wrong_is_named_and_nothing_is_left(
    strange: Path, folder: Path, words: list[str], cause: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    assert main(["export", *words]) == 2
    assert cause in capsys.readouterr().err
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before


def test_measured_positions_of_a_namespace_are_taken_where_there_is_no_truth(
    run: Recording, write_bag: Any, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bag(folder / "bag", run, namespace="/left", lacking=("simulator/ground_truth",))
    assert main(["export", "bag", "--foxglove", "--robot", "two_link"]) == 0
    assert "from /left/joint_states" in capsys.readouterr().err
    messages = decoded(folder / "bag_foxglove.mcap")
    assert len(messages["/left/joint_states"]) == run.time.size
    assert len(messages["/tf"]) == 2 * 200, "100 a second of both arms"


def test_a_bag_without_positions_is_refused(
    run: Recording, write_bag: Any, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bag(folder / "bag", run, lacking=("joint_states", "simulator/ground_truth"))
    assert main(["export", "bag", "--foxglove", "--robot", "two_link"]) == 2
    error = capsys.readouterr().err
    assert "no positions" in error
    assert "/joint_commands (sensor_msgs/msg/JointState)" in error


def test_a_full_disk_leaves_the_old_file(bags: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "out.mcap").write_text("years of work")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
    try:
        assert main(["export", str(bags / "panda"), "--foxglove", "--out", "out.mcap"]) == 1
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "cannot write" in capsys.readouterr().err
    assert [(path.name, path.read_text()) for path in folder.iterdir()] == [("out.mcap", "years of work")]


def test_a_bag_that_was_cut_off_is_played_as_far_as_it_goes(
    bags: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(bags / "panda", folder / "cut")
    (folder / "cut" / "metadata.yaml").unlink()
    file = folder / "cut" / "panda_0.mcap"
    os.truncate(file, file.stat().st_size * 9 // 10)
    assert main(["export", "cut", "--foxglove"]) == 0
    assert "the bag was not finished" in capsys.readouterr().err
    assert 0 < len(decoded(folder / "cut_foxglove.mcap")["/tf"]) < 40


def test_an_interrupted_export_leaves_nothing(bags: Path, folder: Path) -> None:
    def interrupt(done: int, _of: int) -> None:
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), written_file(folder / "out.mcap") as stream:
        write_foxglove(bags / "panda", None, stream, interrupt)
    assert not [*folder.iterdir()]


def test_a_played_file_is_exported_again_without_a_second_tree(played: Path, folder: Path) -> None:
    shutil.copy(played / "scara.mcap", folder / "once.mcap")
    assert main(["export", "once.mcap", "--foxglove"]) == 0
    once, twice = decoded(folder / "once.mcap"), decoded(folder / "once_foxglove.mcap")
    assert {topic: len(found) for topic, found in once.items()} == {topic: len(found) for topic, found in twice.items()}


def test_a_rollout_without_a_bag_is_played(leave: Any, folder: Path) -> None:
    leave(folder / "alone", None, 0.1, bag=False)
    assert main(["export", "alone", "--foxglove"]) == 0
    messages = decoded(folder / "alone_foxglove.mcap")
    assert len(messages["/reference"]) == 100
    assert len(messages["/tf"]) == 20


MJCF = """<mujoco><worldbody><body name="boom"><joint name="turn" axis="0 0 1" actuatorfrcrange="-9 9"/>
<geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03"/><body name="rod" pos="0.4 0 0">
<joint name="lift" type="slide" axis="0 0 1" range="-0.3 0.3" actuatorfrcrange="-40 40"/>
<geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.02"/></body></body></worldbody></mujoco>"""


def test_an_mjcf_has_frames_and_markers_and_no_description(
    leave: Any, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "crane.xml").write_text(MJCF)
    leave(folder / "run", "crane.xml", 0.1)
    assert main(["export", "run", "--foxglove"]) == 0
    assert "viewers cannot read an MJCF" in capsys.readouterr().err
    messages = decoded(folder / "run_foxglove.mcap")
    assert {frame.child_frame_id for message in messages["/tf"] for frame in message.transforms} == {
        prefix + link for prefix in SOURCES for link in ("boom", "rod")
    }
    assert not messages["/robot_description"]
    assert len(messages["/visualization/markers"]) == 20
