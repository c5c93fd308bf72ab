"""Bags are read completely, by stamp and joint name; an unreadable bag gives an error with the reason."""

import json
import re
import shutil
import sqlite3
import tempfile
import warnings
from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pidtsm_core.experiment.node_parameters import NODE_SCHEMAS
from pidtsm_core.parameters import resolve
from pidtsm_core.recording import Recording
from pidtsm_core.recording.outcome import what_happened
from pidtsm_core.references import ReferenceMotion
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_core.signals import Fault, Mode, Status
from pidtsm_core.timing import seconds
from pidtsm_experiments.bags.errors import RecordingError, UnfinishedBag
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.reader import METRICS_ONLY, read_recording
from pidtsm_experiments.bags.writer import BagWriter

REQUIRED = ("simulator/ground_truth", "reference", "controller/state")
TOPICS = (*REQUIRED, "joint_states", "joint_commands")
INDISPENSABLE = [("reference",), ("simulator/ground_truth", "joint_states")]
"""A bag without one of these, or in the second case without both, contains no run."""


@pytest.fixture(scope="session")
def run() -> Recording:
    """0.6 s of Case 1, enough for nearly all of these tests."""
    return rollout(duration=0.6)


def rows(run: Recording, where: slice) -> Recording:
    """Some samples of a run."""
    arrays = {name: array for name, array in vars(run).items() if isinstance(array, np.ndarray)}
    chosen: dict[str, Any] = {name: array[where] for name, array in arrays.items()}
    return replace(run, **chosen)


def permuted(message: Any) -> Any:
    """The same message with its joints in reverse order."""
    arrays = {name: value[::-1].copy() for name, value in vars(message).items() if isinstance(value, np.ndarray)}
    return replace(message, name=message.name[::-1], **arrays)


def assert_is(recording: Recording, run: Recording) -> None:
    """Bit for bit."""
    assert recording.joints == run.joints
    for name in ("time", "position", "velocity", "effort", "reference", "signals", "status"):
        np.testing.assert_array_equal(getattr(recording, name), getattr(run, name), err_msg=name)


@pytest.mark.parametrize("plugin", StoragePlugin)
def test_a_bag_gives_back_the_run(tmp_path: Path, run: Recording, write_bag: Any, plugin: StoragePlugin) -> None:
    recording = read_recording(write_bag(tmp_path / "bag", run, plugin=plugin))
    assert_is(recording, run)
    np.testing.assert_array_equal(recording.compute_time, 2e-5)
    np.testing.assert_array_equal(recording.error, run.position - run.reference[:, 0])
    assert (recording.scenario, recording.law, recording.clock) == ("case1", "piddtsm", "lockstep")
    assert recording.event_time is None
    assert recording.lost == dict.fromkeys(TOPICS[1:], 0)


@pytest.mark.parametrize(("plugin", "suffix"), [(StoragePlugin.MCAP, "mcap"), (StoragePlugin.SQLITE3, "db3")])
def test_the_file_inside_a_bag_is_enough(
    tmp_path: Path, run: Recording, write_bag: Any, plugin: StoragePlugin, suffix: str
) -> None:
    (file,) = write_bag(tmp_path / "bag", run, plugin=plugin).glob(f"*.{suffix}")
    recording = read_recording(file)
    assert_is(recording, run)
    assert recording.scenario == "case1"
    alone = read_recording(file.rename(tmp_path / file.name))
    assert_is(alone, run)
    assert alone.scenario is None


def test_topics_are_found_in_any_namespace(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    assert_is(read_recording(write_bag(tmp_path / "bag", run, namespace="/lab/arm_7")), run)


def test_time_counts_from_the_first_ground_truth(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    start = 1_700_000_000_123_456_789
    time = typestore().types["builtin_interfaces/msg/Time"]

    def edit(topic: str, k: int, message: Any) -> Any:
        if topic == "controller/state" and k < 3:
            return None
        stamp = time(*divmod(start + round(run.time[k] * 1e9), 1_000_000_000))
        return replace(message, header=replace(message.header, stamp=stamp))

    recording = read_recording(write_bag(tmp_path / "bag", run, edit=edit))
    assert_is(recording, rows(run, slice(3, None)))
    assert recording.stamps_ns[0] == start + 3_000_000


def test_what_comes_before_the_first_ground_truth_is_no_sample(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    """In realtime the first joint state is repeated until the controller publishes a command, while time goes on."""
    waited = 20

    def edit(topic: str, k: int, message: Any) -> Any:
        return None if topic == "simulator/ground_truth" and k < waited else message

    recording = read_recording(write_bag(tmp_path / "bag", run, edit=edit))
    assert recording.time[0] == 0.0
    assert recording.stamps_ns[0] == waited * 1_000_000
    np.testing.assert_array_equal(recording.position, run.position[waited:])
    assert not any(recording.lost.values())


@pytest.mark.parametrize(
    "when",
    [
        pytest.param(lambda topic, k: topic != "simulator/ground_truth", id="every message"),
        pytest.param(lambda topic, k: topic != "simulator/ground_truth" and k % 2, id="every second message"),
        pytest.param(lambda topic, k: k > 0, id="all but the first"),
    ],
)
def test_joints_are_matched_by_name(
    tmp_path: Path, run: Recording, write_bag: Any, when: Callable[[str, int], bool]
) -> None:
    path = write_bag(
        tmp_path / "bag", run, edit=lambda topic, k, message: permuted(message) if when(topic, k) else message
    )
    assert_is(read_recording(path), run)


def test_messages_may_be_built_differently(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    """Frame names of another length shift the numbers; other joints add numbers."""

    def edit(topic: str, k: int, message: Any) -> Any:
        message = replace(message, header=replace(message.header, frame_id="x" * (k % 11)))
        if k % 3 or topic == "simulator/ground_truth":
            return message
        arrays = {n: np.append(9.0, v) for n, v in vars(message).items() if isinstance(v, np.ndarray) and v.size}
        return replace(message, name=["gripper", *message.name], **arrays)

    assert_is(read_recording(write_bag(tmp_path / "bag", run, edit=edit)), run)


def test_lost_counts_the_stamps_of_the_ground_truth_without_a_partner(
    tmp_path: Path, run: Recording, write_bag: Any
) -> None:
    dropped = {"reference": range(5), "controller/state": range(4, 10), "joint_commands": range(100, 103)}
    recording = read_recording(
        write_bag(tmp_path / "bag", run, edit=lambda topic, k, m: None if k in dropped.get(topic, ()) else m)
    )
    assert recording.lost == {"reference": 5, "controller/state": 6, "joint_states": 0, "joint_commands": 3}
    np.testing.assert_array_equal(recording.time, np.delete(run.time, range(4, 10)))


def test_a_message_sent_twice_counts_once(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    def edit(topic: str, k: int, message: Any) -> Any:
        if (topic, k) != ("reference", 5):
            return message
        return replace(message, header=replace(message.header, stamp=replace(message.header.stamp, nanosec=4_000_000)))

    recording = read_recording(write_bag(tmp_path / "bag", run, edit=edit))
    assert recording.lost["reference"] == 1
    np.testing.assert_array_equal(recording.reference[4], run.reference[4])


def test_only_what_is_needed_must_be_there(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    recording = read_recording(write_bag(tmp_path / "bag", run, lacking=("joint_states", "joint_commands")))
    assert_is(recording, run)
    assert set(recording.lost) == {"reference", "controller/state"}


def test_foreign_bags_have_no_metadata_of_the_run(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    recording = read_recording(write_bag(tmp_path / "bag", run, metadata=None))
    assert (recording.scenario, recording.law, recording.clock, recording.event_time) == (None,) * 4
    assert (recording.robot, recording.slides) == ({}, (False, False))


def test_the_arm_comes_from_the_recorder(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    known = {"robot": {"robot.description": "gone.urdf"}, "sliding": ["joint2"], "continuous": ["joint1"]}
    recording = read_recording(write_bag(tmp_path / "bag", run, metadata=known))
    assert recording.robot == known["robot"]
    assert (recording.slides, recording.continuous) == ((False, True), (True, False))


def test_the_event_comes_from_the_recorder(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    recording = read_recording(write_bag(tmp_path / "bag", run, metadata={"event_time": 1, "unknown": "ignored"}))
    assert recording.event_time == 1.0
    assert recording.scenario is None


def test_bags_without_message_definitions_are_read(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    """As written by ROS 2 Humble."""
    path = write_bag(tmp_path / "bag", run, plugin=StoragePlugin.SQLITE3)
    (file,) = path.glob("*.db3")
    database = sqlite3.connect(file)
    with database:
        database.execute("DELETE FROM message_definitions")
    database.close()
    assert_is(read_recording(path), run)


@settings(max_examples=20, deadline=None)
@given(lost=st.fixed_dictionaries({topic: st.sets(st.integers(0, 9)) for topic in TOPICS}))
def test_samples_are_the_stamps_of_controller_states_and_of_ground_truth_alone(
    run: Recording, write_bag: Any, lost: dict[str, set[int]]
) -> None:
    short = rows(run, slice(10))
    kept = {topic: set(range(10)) - lost[topic] for topic in TOPICS}
    assume(all(kept[topic] for topic in REQUIRED))  # Else it is the bag of a real arm, or of another controller.
    truth = kept["simulator/ground_truth"]
    complete = set.intersection(*(kept[topic] for topic in REQUIRED))
    alone = truth - set[int]().union(*(kept[topic] for topic in TOPICS[1:]))
    # Nothing can be interpolated from a single reference.
    unsent, unreferred = set(), set()
    if len(kept["reference"]) > 1:
        unsent, unreferred = alone, truth & kept["controller/state"] - kept["reference"]
    samples = sorted(complete | unsent | unreferred)
    with tempfile.TemporaryDirectory() as folder:
        path = write_bag(Path(folder, "bag"), short, edit=lambda topic, k, m: None if k in lost[topic] else m)
        if not complete:
            with pytest.raises(RecordingError):
                read_recording(path)
            return
        recording = read_recording(path)
    np.testing.assert_array_equal(recording.effort, short.effort[samples])
    assert recording.lost == {topic: len(truth - unsent - kept[topic]) for topic in TOPICS[1:]}


def lose(samples: set[int]) -> Callable[[str, int, Any], Any]:
    """At these samples there is no measurement, hence no reference and no command."""
    return lambda topic, k, message: message if topic == "simulator/ground_truth" or k not in samples else None


def test_measurements_lost_at_the_sensor_are_not_counted_as_lost(
    tmp_path: Path, run: Recording, write_bag: Any
) -> None:
    """The reference is interpolated within the accuracy of all metrics, and the controller's signals are held."""
    unsent = {0, 7, *range(100, 120), 500, len(run.time) - 2, len(run.time) - 1}
    recording = read_recording(write_bag(tmp_path / "bag", run, edit=lose(unsent)))
    assert set(recording.lost.values()) == {0}
    for name in ("time", "position", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(recording, name), getattr(run, name), err_msg=name)
    sent = sorted(set(range(len(run.time))) - unsent)
    np.testing.assert_array_equal(recording.reference[sent], run.reference[sent])
    np.testing.assert_array_less(
        np.abs(recording.reference - run.reference).max(axis=(0, 2)), [1e-10, 1e-7, 1e-4], err_msg="q, q', q''"
    )
    np.testing.assert_array_equal(recording.signals[sent], run.signals[sent])
    assert not recording.signals[0].any()
    np.testing.assert_array_equal(recording.signals[100:120], run.signals[[99] * 20])
    only_metrics = read_recording(tmp_path / "bag", METRICS_ONLY)
    np.testing.assert_array_equal(only_metrics.error, recording.error)


def test_a_silence_too_long_to_interpolate_is_lost(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    silent = range(len(run.time) - 150, len(run.time))
    recording = read_recording(write_bag(tmp_path / "bag", run, edit=lose(set(silent))))
    assert set(recording.lost.values()) == {50}
    np.testing.assert_array_equal(recording.time, run.time[:-50])


# Missing references in bags with the trajectory's parameters.


def motion(**settings: Any) -> dict[str, Any]:
    """Every parameter of the trajectory, by name."""
    return resolve(NODE_SCHEMAS["trajectory"], {name.replace("__", "."): v for name, v in settings.items()}, 2)


def knowing(parameters: dict[str, Any]) -> dict[str, Any]:
    """Metadata of a bag that has them."""
    return {"scenario": "case1", "trajectory": parameters}


def referred(run: Recording, parameters: dict[str, Any], begun: int = 0) -> Recording:
    """The run with another reference that begins at the given sample."""
    reference, built = np.empty_like(run.reference), ReferenceMotion(parameters)
    for k in range(len(run.time)):
        built.evaluate(seconds((k - begun) * 1_000_000), reference[k])
    return replace(run, reference=reference)


def silent(samples: set[int]) -> Callable[[str, int, Any], Any]:
    """At these samples the trajectory publishes messages without a reference, as in lockstep."""

    def edit(topic: str, k: int, message: Any) -> Any:
        if topic != "reference" or k not in samples:
            return message
        return replace(message, name=[], position=np.empty(0), velocity=np.empty(0), acceleration=np.empty(0))

    return edit


LATE = {0, 1, 2, 7, *range(100, 300), 500, 598, 599}


def test_the_reference_of_measurements_lost_at_the_sensor_is_exact(
    tmp_path: Path, run: Recording, write_bag: Any
) -> None:
    """It begins at the first measurement that was published."""
    parameters = motion(jump__position=0.1, jump__time=0.2)
    expected = referred(run, parameters, begun=3)
    recording = read_recording(write_bag(tmp_path / "bag", expected, edit=lose(LATE), metadata=knowing(parameters)))
    for name in ("time", "position", "effort", "reference"):
        np.testing.assert_array_equal(getattr(recording, name), getattr(expected, name), err_msg=name)
    assert set(recording.lost.values()) == {0}


def test_exact_references_follow_the_joints_by_name(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    parameters = motion(joints=["joint2", "joint1"])
    other = referred(run, parameters)
    expected = replace(other, reference=other.reference[:, :, ::-1].copy())
    recording = read_recording(write_bag(tmp_path / "bag", expected, edit=lose({5, 6}), metadata=knowing(parameters)))
    np.testing.assert_array_equal(recording.reference, expected.reference)


def test_samples_without_a_reference_are_kept_and_nothing_is_lost(
    tmp_path: Path, run: Recording, write_bag: Any
) -> None:
    parameters = motion()
    recording = read_recording(
        write_bag(tmp_path / "bag", run, edit=silent(LATE - {0, 1, 2}), metadata=knowing(parameters))
    )
    assert_is(recording, run)
    assert set(recording.lost.values()) == {0}


def test_messages_without_values_may_be_followed_by_any_bytes(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    """As written by Fast CDR."""
    parameters = motion()
    with (
        AnyReader([write_bag(tmp_path / "exact", run, silent(LATE), knowing(parameters))]) as reader,
        Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer,
    ):
        writer.set_custom_data("pidtsm", json.dumps(knowing(parameters)))
        connections = {
            c.topic: writer.add_connection(c.topic, c.msgtype, typestore=typestore()) for c in reader.connections
        }
        for k, (connection, time, payload) in enumerate(reader.messages()):
            empty = connection.topic == "/reference" and time // 1_000_000 in LATE
            tail = k.to_bytes(4, "little") * 2 if empty else b""
            writer.write(connections[connection.topic], time, payload + tail)
    assert_is(read_recording(tmp_path / "bag"), run)


def test_the_motion_begins_with_the_first_reference_even_without_values(
    tmp_path: Path, run: Recording, write_bag: Any
) -> None:
    recording = read_recording(
        write_bag(tmp_path / "bag", run, edit=silent(set(range(300))), metadata=knowing(motion()))
    )
    assert_is(recording, run)


def test_references_in_a_simulated_loss_are_not_counted_as_lost(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    """In realtime the trajectory then publishes nothing."""

    def edit(topic: str, k: int, message: Any) -> Any:
        return None if topic == "reference" and (k == 10 or 100 <= k < 400) else message

    parameters = motion(dropout__time=0.1, dropout__duration=0.3)
    recording = read_recording(write_bag(tmp_path / "bag", run, edit=edit, metadata=knowing(parameters)))
    assert_is(recording, run)
    assert recording.lost["reference"] == 1


@pytest.mark.parametrize(
    "parameters",
    [
        pytest.param(motion(reference__name="sines"), id="another motion"),
        pytest.param({**motion(), "reference.name": "secret"}, id="an unknown motion"),
        pytest.param({**motion(), "joints": ("shoulder", "elbow")}, id="other joints"),
        pytest.param({"reference.name": "csv", "reference.file": "/dev/zero"}, id="no file"),
        pytest.param([], id="no parameters"),
    ],
)
def test_a_motion_that_differs_from_the_recorded_one_is_not_used(
    tmp_path: Path, run: Recording, write_bag: Any, parameters: Any
) -> None:
    lost = {7, *range(200, 450)}
    recording = read_recording(write_bag(tmp_path / "bag", run, edit=lose(lost), metadata=knowing(parameters)))
    kept = np.delete(np.arange(len(run.time)), range(300, 350))
    np.testing.assert_array_equal(recording.time, run.time[kept])
    difference = np.abs(recording.reference[:, 0] - run.reference[kept, 0])
    assert 0.0 < difference.max() < 1e-3


def test_a_motion_that_was_replaced_during_the_run_is_not_used(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    """By a commanded trajectory, around a gap."""
    reference = run.reference.copy()
    reference[490:510] += 0.5
    edited = replace(run, reference=reference)
    path = write_bag(tmp_path / "bag", edited, edit=lose({500}), metadata=knowing(motion()))
    np.testing.assert_allclose(read_recording(path).reference[500, 0], reference[500, 0], atol=1e-9)


# Status of the controller.


@pytest.fixture(scope="module")
def stopped() -> Recording:
    """The reference of the second joint jumps too far."""
    run = rollout(
        controller={"limits.tracking_error": [0.0, 0.3]},
        trajectory={"jump.time": 0.3, "jump.position": [0.0, 0.5]},
        duration=0.6,
    )
    assert run.status[-1, :3].tolist() == [Mode.STOPPED, Fault.TRACKING_LIMIT, 2]
    return run


@pytest.mark.parametrize("turned", [False, True])
def test_the_status_is_read_by_the_names_of_joints(
    tmp_path: Path, stopped: Recording, write_bag: Any, turned: bool
) -> None:
    def edit(topic: str, k: int, message: Any) -> Any:
        if topic != "controller/state" or not turned:
            return message
        return replace(permuted(message), fault_joint=3 - message.fault_joint if message.fault_joint else 0)

    assert_is(read_recording(write_bag(tmp_path / "bag", stopped, edit=edit)), stopped)


def test_the_status_is_held_while_no_measurement_comes(tmp_path: Path, stopped: Recording, write_bag: Any) -> None:
    recording = read_recording(write_bag(tmp_path / "bag", stopped, edit=lose({0, 1, *range(310, 320)})))
    np.testing.assert_array_equal(recording.status, stopped.status)


def test_messages_without_the_joint_of_a_fault_are_read(tmp_path: Path, stopped: Recording, write_bag: Any) -> None:
    kind = "pidtsm_msgs/msg/ControllerState"
    definition = typestore().generate_msgdef(kind)[0]
    old = get_typestore(Stores.ROS2_JAZZY)
    old.register(
        get_types_from_msg(re.sub(r"uint8 (fault_joint|violations)\n", "", definition.split("=" * 80)[0]), kind)
    )
    with (
        AnyReader([write_bag(tmp_path / "new", stopped)]) as reader,
        Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer,
    ):
        connections = {
            c.topic: writer.add_connection(c.topic, c.msgtype, typestore=old if c.msgtype == kind else typestore())
            for c in reader.connections
        }
        for connection, time, message in reader.messages():
            payload: bytes | memoryview = message
            if connection.msgtype == kind:
                values = vars(reader.deserialize(message, kind))
                fields = [name for name, _ in old.get_msgdef(kind).fields]
                assert "violations" not in fields
                payload = old.serialize_cdr(old.types[kind](*(values[name] for name in fields)), kind)
            writer.write(connections[connection.topic], time, payload)
    recording = read_recording(tmp_path / "bag")
    known = [Status.MODE, Status.FAULT]
    np.testing.assert_array_equal(recording.status[:, known], stopped.status[:, known])
    assert not recording.status[:, [Status.FAULT_JOINT, Status.VIOLATIONS]].any()
    np.testing.assert_array_equal(recording.signals, stopped.signals)


def test_rejected_messages_are_the_last_count_of_the_own_nodes(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    reports = [{"simulator": "0"}, {"lab/controller": "7", "controller": "1"}, {"controller": "12", "odd": "many"}]
    recording = read_recording(write_bag(tmp_path / "bag", rows(run, slice(3)), reports=reports))
    assert recording.rejected == {"simulator": 0, "controller": 12}
    assert set(recording.lost) == set(TOPICS[1:])
    alone = read_recording(write_bag(tmp_path / "lab", rows(run, slice(3)), namespace="/lab", reports=reports))
    assert alone.rejected == {"controller": 7}


def test_what_the_controller_has_found_is_in_the_metrics(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    bag = write_bag(tmp_path / "bag", rows(run, slice(3)), reports=[{"simulator": "0", "controller": "0"}])
    metrics = read_recording(bag).metrics()
    friction = {"what": "friction", "joint": "joint1", "value": 6.1, "deviation": 0.3, "unit": "N m"}
    assert metrics["found"] == [friction]
    assert "joint1: found 6.1 ± 0.3 N m of friction beyond compensation.coulomb" in what_happened(metrics)


@pytest.mark.parametrize("reports", [(), [{"other/controller": "3"}]])
def test_without_diagnostics_of_the_nodes_rejections_are_unknown(
    tmp_path: Path, run: Recording, write_bag: Any, reports: Any
) -> None:
    recording = read_recording(write_bag(tmp_path / "bag", rows(run, slice(3)), reports=reports))
    assert recording.rejected is None
    assert recording.found is None


# Unreadable bags: how each is made from an intact one, and the expected error text.


def killed(bag: Path) -> Path:
    """No metadata.yaml, and the MCAP file ends where the recorder was killed."""
    (bag / "metadata.yaml").unlink()
    cut_file(bag)
    return bag


def cut_file(bag: Path) -> Path:
    (file,) = bag.glob("*.mcap")
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 3 // 4])  # after its first chunk
    return file


def cut(bag: Path) -> Path:
    cut_file(bag)
    return bag


def emptied(bag: Path) -> Path:
    cut_file(bag).write_bytes(b"")
    return bag


def damaged(bag: Path) -> Path:
    """Zeros over the middle of the messages."""
    (file,) = bag.glob("*.mcap")
    content = bytearray(file.read_bytes())
    content[20_000:400_000] = bytes(380_000)
    file.write_bytes(content)
    return bag


def without_file(bag: Path) -> Path:
    (file,) = bag.glob("*.mcap")
    file.unlink()
    return bag


def bad_yaml(bag: Path) -> Path:
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    return bag


def gone(bag: Path) -> Path:
    shutil.rmtree(bag)
    return bag


def only_a_folder(bag: Path) -> Path:
    gone(bag).mkdir()
    return bag


def only_a_text(bag: Path) -> Path:
    gone(bag).write_text("hello")
    return bag


@pytest.mark.parametrize(
    ("breaking", "reason"),
    [
        (gone, "no such file"),
        (only_a_folder, "not a bag"),
        (only_a_text, "not a whole bag"),
        (emptied, "was not finished, and nothing in it can be read"),
        (damaged, "mcap recover"),
        (without_file, "missing"),
        (bad_yaml, "YAML"),
    ],
)
def test_errors_of_damaged_files_contain_the_reason(
    tmp_path: Path, run: Recording, write_bag: Any, breaking: Callable[[Path], Path], reason: str
) -> None:
    path = breaking(write_bag(tmp_path / "bag", run))
    with pytest.raises(RecordingError, match=reason) as caught:
        read_recording(path)
    assert str(path) in str(caught.value)


@pytest.fixture(scope="module")
def long_run() -> Recording:
    """A run whose bag has several chunks."""
    return rollout(duration=2.0)


@pytest.mark.parametrize("breaking", [killed, cut, cut_file])
def test_an_unfinished_bag_is_read_with_a_warning_about_what_is_missing(
    tmp_path: Path, long_run: Recording, write_bag: Any, breaking: Callable[[Path], Path]
) -> None:
    path = breaking(write_bag(tmp_path / "bag", long_run))
    content = {file: file.read_bytes() for file in (tmp_path / "bag").iterdir()}
    with pytest.warns(UnfinishedBag, match=r"was not finished .*Everything after \d\.\d{3} s is missing") as caught:
        recording = read_recording(path)
    assert len(caught) == 1
    samples = recording.time.size
    assert 100 < samples < long_run.time.size
    np.testing.assert_array_equal(recording.position, long_run.position[:samples])
    np.testing.assert_array_equal(recording.effort, long_run.effort[:samples])
    assert {file: file.read_bytes() for file in (tmp_path / "bag").iterdir()} == content


def test_topics_that_end_earlier_are_named(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    def stop_state(topic: str, k: int, message: Any) -> Any:
        return None if topic == "controller/state" and k >= 300 else message

    path = write_bag(tmp_path / "bag", run, edit=stop_state)
    (path / "metadata.yaml").unlink()
    with pytest.warns(UnfinishedBag, match=r"topics that end earlier: controller/state at 0\.299 s"):
        read_recording(path)


@pytest.fixture(scope="module")
def small_bag(tmp_path_factory: pytest.TempPathFactory, run: Recording, write_bag: Any) -> bytes:
    """The only file of an unfinished bag with many chunks."""
    folder = tmp_path_factory.mktemp("small")
    writer = BagWriter(folder / "bag", json.dumps({"scenario": "case1"}), max_size=0, max_duration=0.0)
    with AnyReader([write_bag(folder / "whole", rows(run, slice(100)))]) as reader:
        topics = {c.topic: writer.add_topic(c.topic, c.msgtype) for c in reader.connections}
        for k, (connection, time, payload) in enumerate(reader.messages()):
            writer.write(topics[connection.topic], time, payload)
            if k % 50 == 49:
                writer.flush()
    writer.abort()
    return (folder / "bag" / "bag_0.mcap").read_bytes()


@pytest.mark.parametrize("end", range(0, 100_000, 1999))
def test_a_bag_may_be_cut_anywhere(tmp_path: Path, run: Recording, small_bag: bytes, end: int) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    (folder / "bag_0.mcap").write_bytes(small_bag[:end])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnfinishedBag)
        # Before the end of the first chunk nothing is readable, which is an error.
        with suppress(RecordingError) if end < 30_000 else nullcontext():
            recording = read_recording(folder)
            assert recording.scenario == "case1"
            np.testing.assert_array_equal(recording.position, run.position[: recording.time.size])


def test_references_of_older_versions_without_an_effort_are_read(
    tmp_path: Path, run: Recording, write_bag: Any
) -> None:
    kind, old = "pidtsm_msgs/msg/JointReference", get_typestore(Stores.ROS2_JAZZY)
    fields = "".join(f"float64[] {name}\n" for name in ("position", "velocity", "acceleration"))
    old.register(get_types_from_msg(f"std_msgs/Header header\nstring[] name\n{fields}", kind))
    with (
        AnyReader([write_bag(tmp_path / "new", run)]) as reader,
        Writer(tmp_path / "old", version=9, storage_plugin=StoragePlugin.MCAP) as writer,
    ):
        stores = {c.topic: old if c.msgtype == kind else typestore() for c in reader.connections}
        topics = {
            c.topic: writer.add_connection(c.topic, c.msgtype, typestore=stores[c.topic]) for c in reader.connections
        }
        for connection, time, payload in reader.messages():
            if connection.msgtype == kind:
                new: Any = reader.deserialize(payload, kind)
                values = (new.position, new.velocity, new.acceleration)
                data = old.serialize_cdr(old.types[kind](new.header, new.name, *values), kind)
            else:
                data = memoryview(payload)
            writer.write(topics[connection.topic], time, bytes(data))
    assert_is(read_recording(tmp_path / "old"), run)


def test_a_bag_without_messages_is_reported(tmp_path: Path) -> None:
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.add_connection("/reference", "pidtsm_msgs/msg/JointReference", typestore=typestore())
    with pytest.raises(RecordingError, match="no messages: was anything running"):
        read_recording(tmp_path / "bag")


@pytest.mark.parametrize("topics", INDISPENSABLE)
def test_a_missing_topic_is_named_with_the_existing_ones(
    tmp_path: Path, run: Recording, write_bag: Any, topics: tuple[str, ...]
) -> None:
    path = write_bag(tmp_path / "bag", run, lacking=topics)
    with pytest.raises(RecordingError, match=rf"lacks {topics[0]} \(.*; it has .*/joint_commands \(sensor_msgs"):
        read_recording(path)


@pytest.mark.parametrize("topics", INDISPENSABLE)
def test_a_topic_without_messages_is_named(
    tmp_path: Path, run: Recording, write_bag: Any, topics: tuple[str, ...]
) -> None:
    path = write_bag(tmp_path / "bag", run, edit=lambda name, k, message: None if name in topics else message)
    with pytest.raises(RecordingError, match=f"no messages on /{topics[-1]}"):
        read_recording(path)


def test_two_robots_in_a_bag_are_refused(tmp_path: Path, run: Recording) -> None:
    store = typestore()
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic in ("/a/ground_truth", "/b/ground_truth"):
            connection = writer.add_connection(topic, "sensor_msgs/msg/JointState", typestore=store)
            writer.write(connection, 0, b"\x00\x01\x00\x00")
    with pytest.raises(RecordingError, match="/a/ground_truth, /b/ground_truth"):
        read_recording(tmp_path / "bag")


def with_values(topic: str, **values: Any) -> Callable[[str, int, Any], Any]:
    """Edit sample 7 of a topic."""
    return lambda name, k, message: replace(message, **values) if (name, k) == (topic, 7) else message


@pytest.mark.parametrize(
    ("edit", "reason"),
    [
        (with_values("reference", position=np.array([0.0, np.nan])), "reference .*not finite.* 7000000 ns"),
        (with_values("controller/state", effort=np.array([np.inf, 0.0])), "controller/state .*not finite"),
        (with_values("controller/state", compute_time=np.nan), "controller/state .*not finite"),
        (with_values("controller/state", name=["joint1", "elbow"]), "controller/state lacks joint2"),
        (with_values("simulator/ground_truth", effort=np.empty(0)), "ground_truth has 0 values of effort for 2"),
        (with_values("reference", velocity=np.zeros(3)), "reference has 3 values of velocity for 2"),
    ],
)
def test_a_bad_message_is_named(tmp_path: Path, run: Recording, write_bag: Any, edit: Any, reason: str) -> None:
    path = write_bag(tmp_path / "bag", run, edit=edit)
    with pytest.raises(RecordingError, match=reason):
        read_recording(path)


def test_a_payload_that_is_no_message_is_named(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    store = typestore()
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, kind in [
            ("/ground_truth", "sensor_msgs/msg/JointState"),
            ("/reference", "pidtsm_msgs/msg/JointReference"),
            ("/controller/state", "pidtsm_msgs/msg/ControllerState"),
        ]:
            writer.write(writer.add_connection(topic, kind, typestore=store), 0, b"\x00\x01\x00\x00short")
    with pytest.raises(RecordingError, match="a message of simulator/ground_truth cannot be read"):
        read_recording(tmp_path / "bag")


def test_topics_without_common_stamps_are_reported(tmp_path: Path, run: Recording, write_bag: Any) -> None:
    def edit(topic: str, k: int, message: Any) -> Any:
        stamp = message.header.stamp
        late = replace(message.header, stamp=replace(stamp, nanosec=stamp.nanosec + 1))
        return replace(message, header=late) if topic == "reference" else message

    path = write_bag(tmp_path / "bag", run, edit=edit)
    with pytest.raises(RecordingError, match="no stamp is in all of simulator/ground_truth, reference"):
        read_recording(path)


@pytest.mark.parametrize("text", ["{", "[]", '{"event_time": "soon"}', '{"robot": "scara"}'])
def test_bad_metadata_is_reported(tmp_path: Path, run: Recording, write_bag: Any, text: str) -> None:
    path = write_bag(tmp_path / "bag", run, metadata=text)
    with pytest.raises(RecordingError, match="custom data"):
        read_recording(path)
