"""Demonstrations as a dataset of LeRobot, judged by pyarrow and what LeRobot's loader reads (its sources, v3.0)."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from pidtsm_experiments.cli import main

parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is optional (requirements/parquet.lock)")

SECOND = 1_000_000_000
JOINTS = ["elbow", "shoulder"]
STATISTICS = {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}
FEATURES = ["observation.state", "action", "timestamp", "frame_index", "episode_index", "index", "task_index"]


def posture(t: Any) -> Any:
    return np.stack([0.5 * np.sin(t), 0.3 * np.cos(2.0 * t) - 0.3], axis=-1)


def record(bag: Path, joints: Sequence[str] = JOINTS, duration: float = 2.0) -> Path:
    """Joint states at 200 Hz, as another recorder would store them; the joints of every other in another order."""
    store, kind = get_typestore(Stores.ROS2_JAZZY), "sensor_msgs/msg/JointState"
    state, header, time = (store.types[name] for name in (kind, "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    none = np.zeros(0)
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_states", kind, typestore=store)
        for i in range(round(duration * 200.0)):
            stamp, step = 7 * SECOND + i * SECOND // 200, -1 if i % 2 else 1
            position = posture(i / 200.0)[::step].copy()
            head = header(time(stamp // SECOND, stamp % SECOND), "")
            message = state(head, list(joints)[::step], position, none, none)
            writer.write(connection, stamp, store.serialize_cdr(message, kind))
    return bag


@pytest.fixture
def bag(folder: Path) -> Path:
    return record(folder / "first")


@pytest.fixture
def dataset(bag: Path, folder: Path) -> Path:
    second = record(folder / "second", JOINTS[::-1], 1.0)
    words = ["--format", "lerobot", "--episodes", str(second), "--task", "Wave.", "--fps", "25", "--out", "wave"]
    assert main(["export", str(bag), *words]) == 0
    return folder / "wave"


def test_frames_are_the_motion_at_a_regular_rate(dataset: Path) -> None:
    table = parquet.read_table(dataset / "data" / "chunk-000" / "file-000.parquet").to_pydict()
    assert [*table] == FEATURES
    assert table["index"] == list(range(75))
    assert table["episode_index"] == [0] * 50 + [1] * 25
    assert table["frame_index"] == [*range(50), *range(25)]
    assert set(table["task_index"]) == {0}
    times = np.array(table["timestamp"])
    np.testing.assert_allclose(times, [*np.arange(50) / 25.0, *np.arange(25) / 25.0], rtol=1e-6)
    states, actions = np.array(table["observation.state"]), np.array(table["action"])
    np.testing.assert_allclose(states[:50], posture(times[:50]), atol=1e-5)
    np.testing.assert_allclose(states[50:], posture(times[50:])[:, ::-1], atol=1e-5)
    np.testing.assert_array_equal(actions[:49], states[1:50])
    np.testing.assert_array_equal(actions[49], states[49])


def test_what_the_loader_of_lerobot_reads_is_there(dataset: Path) -> None:
    info = json.loads((dataset / "meta" / "info.json").read_text())
    assert (info["codebase_version"], info["fps"]) == ("v3.0", 25)
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (2, 75, 1)
    assert info["splits"] == {"train": "0:2"}
    schema = parquet.read_schema(dataset / info["data_path"].format(chunk_index=0, file_index=0))
    assert [*info["features"]] == schema.names == FEATURES
    for name, feature in info["features"].items():
        kind = schema.field(name).type
        length, kind = (kind.list_size, kind.value_type) if name in FEATURES[:2] else (1, kind)
        assert ([length], {"float": "float32"}.get(str(kind), str(kind))) == (feature["shape"], feature["dtype"])
    assert info["features"]["action"]["names"] == JOINTS
    rows = parquet.read_table(dataset / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()
    assert [(row["dataset_from_index"], row["dataset_to_index"], row["length"]) for row in rows] == [
        (0, 50, 50),
        (50, 75, 25),
    ]
    assert {row["tasks"][0] for row in rows} == {"Wave."}
    places = {
        row[f"{of}/{index}_index"] for row in rows for of in ("data", "meta/episodes") for index in ("chunk", "file")
    }
    assert places == {0}
    tasks = parquet.read_table(dataset / "meta" / "tasks.parquet")
    assert tasks.to_pydict() == {"task_index": [0], "task": ["Wave."]}
    assert tasks.schema.pandas_metadata["index_columns"] == ["task"]


def test_statistics_are_those_of_the_frames(dataset: Path) -> None:
    states = np.array(parquet.read_table(dataset / "data")["observation.state"].to_pylist())
    whole = json.loads((dataset / "meta" / "stats.json").read_text())
    assert {name: set(found) for name, found in whole.items()} == dict.fromkeys(FEATURES, STATISTICS)
    row = parquet.read_table(dataset / "meta" / "episodes").to_pylist()[1]
    for found, of in (
        (whole["observation.state"], states),
        ({k: row[f"stats/observation.state/{k}"] for k in STATISTICS}, states[50:]),
    ):
        assert found["count"] == [len(of)]
        np.testing.assert_allclose(found["mean"], of.mean(axis=0), atol=1e-6)
        np.testing.assert_allclose(found["std"], of.std(axis=0), atol=1e-6)
        np.testing.assert_allclose([found["min"], found["max"]], [of.min(axis=0), of.max(axis=0)])
        np.testing.assert_allclose(found["q90"], np.quantile(of, 0.9, axis=0))


def test_an_episode_is_a_motion_again(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["replay-motion", str(dataset), "--episode", "1", "--dry-run", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["duration"] == pytest.approx(0.96)
    last = posture(0.96)[::-1]
    for joint, name, q in zip(told["joints"], JOINTS, last, strict=True):
        assert joint["joint"] == name
        assert min(abs(joint["largest"] - q), abs(joint["smallest"] - q), abs(joint["first"] - q)) < 5e-3


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--fps", "0"], "--fps 0: must be 1 to 1000"),
        (["--task", " "], "--task: must not be empty"),
        (["--actions", "reference"], "no messages reference"),
        (["--episodes", "strange"], "strange: has finger, wrist; the first bag elbow, shoulder"),
        (["--episodes", "short"], "short: lasts 0.01 s; two frames at 30 per second are needed"),
        (["--episodes", "absent"], "absent: no such file or folder"),
        (["--out", "first"], "exists; name a new folder"),
        (["--out", "no/where"], "is not a folder"),
        (["--csv", "a.csv"], "--format lerobot and --csv"),
    ],
)
def test_what_cannot_be_a_dataset_is_refused_with_the_reason(
    bag: Path, folder: Path, words: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    record(folder / "strange", ["finger", "wrist"])
    record(folder / "short", duration=0.015)
    before = sorted(folder.iterdir())
    assert main(["export", str(bag), "--format", "lerobot", *words]) == 2
    assert reason in capsys.readouterr().err.replace("\n", " ")
    assert sorted(folder.iterdir()) == before


def test_what_is_no_dataset_is_refused_with_the_reason(
    dataset: Path, bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(*words: str) -> str:
        assert main(["replay-motion", *words, "--dry-run"]) == 2
        return capsys.readouterr().err.replace("\n", " ")

    assert "no episode 2; there are 0 to 1" in refused(str(dataset), "--episode", "2")
    assert "is no dataset of LeRobot" in refused(str(bag), "--episode", "0")
    info = dataset / "meta" / "info.json"
    whole = info.read_text()
    info.write_text(whole.replace("v3.0", "v2.1"))
    assert "format v2.1; LeRobot converts it to v3.0" in refused(str(dataset))
    info.write_text(whole.replace('"elbow"', "1"))
    assert "no observation.state with names of joints" in refused(str(dataset))
    info.write_text(whole[:100])
    assert "not a whole dataset" in refused(str(dataset))
    info.write_text(whole)
    (dataset / "data" / "chunk-000" / "file-000.parquet").write_bytes(b"PAR1")
    assert "not a whole dataset" in refused(str(dataset))


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_tables_can_be_named_as_formats(bag: Path, folder: Path, kind: str) -> None:
    assert main(["export", str(bag), "--format", kind]) == 0
    assert (folder / f"first.{kind}").stat().st_size > 1000
