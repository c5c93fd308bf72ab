"""Runs and bags as tables, judged by the csv module and pyarrow."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.saved import read_run


def test_every_number_is_in_the_table_to_the_last_bit(kept: Path, folder: Path) -> None:
    assert main(["export", str(kept / "firm"), "--csv", "firm.csv"]) == 0
    with (folder / "firm.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    run = read_run(kept / "firm")
    table = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    np.testing.assert_array_equal(table["time"], run.time)
    for name, array in run.arrays().items():
        for j, joint in enumerate(run.joints):
            np.testing.assert_array_equal(table[f"{name}.{joint}"], array[:, j])
    assert len(header) == 1 + len(run.arrays()) * len(run.joints)


@pytest.mark.parametrize(
    ("run", "file", "cause"),
    [("nothing", "run.csv", "nothing"), ("firm", "no/run.csv", "--csv no/run.csv"), ("firm", ".", "is a folder")],
)
def test_what_cannot_be_read_or_written_is_named(
    kept: Path, folder: Path, run: str, file: str, cause: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(kept / run), "--csv", file]) == 2
    assert cause in capsys.readouterr().err
    assert not [*folder.iterdir()]


@pytest.fixture
def strange(folder: Path) -> Path:
    """A bag of an arm and a gripper that no run has recorded; the gripper has no velocity."""
    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "sensor_msgs/msg/JointState"
    state, header, time = (store.types[name] for name in (kind, "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    none = np.zeros(0)
    with Writer(folder / "strange", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        arm, gripper = (writer.add_connection(f"/{name}/states", kind, typestore=store) for name in ("arm", "gripper"))
        for i in range(3):
            stamp = header(time(7, 100 * i), "")
            message = state(stamp, ["b", "a"], np.array([1.0, 0.1]) * i, np.array([0.5, 1.0 / 3.0]), none)
            writer.write(arm, i, store.serialize_cdr(message, kind))
        message = state(header(time(8, 0), ""), ["finger"], np.array([0.02]), none, none)
        writer.write(gripper, 9, store.serialize_cdr(message, kind))
    return folder / "strange"


STRANGE = [
    *(
        ("/arm/states", 100 * i, joint, q, v)
        for i in range(3)
        for joint, q, v in (("b", 1.0 * i, 0.5), ("a", 0.1 * i, 1 / 3))
    ),
    ("/gripper/states", 10**9, "finger", 0.02, None),
]
"""Topic, ns since the first stamp, joint, position and velocity of each row."""


def test_any_bag_is_a_table_of_its_messages(strange: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(strange), "--csv", "strange.csv"]) == 0
    assert "no run: " in capsys.readouterr().err
    with (folder / "strange.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [*rows[0]] == ["topic", "time", "stamp", "joint", "position", "velocity", "effort"]
    read = [
        (
            row["topic"],
            int(row["stamp"]) - 7 * 10**9,
            row["joint"],
            float(row["position"]),
            float(row["velocity"]) if row["velocity"] else None,
        )
        for row in rows
    ]
    assert read == STRANGE
    assert [float(row["time"]) for row in rows] == [row[1] / 1e9 for row in STRANGE]
    assert {row["effort"] for row in rows} == {""}


def test_parquet_has_the_same_numbers(strange: Path, kept: Path, folder: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is optional (requirements/parquet.lock)")
    assert main(["export", str(strange), "--parquet", "strange.parquet"]) == 0
    table = parquet.read_table(folder / "strange.parquet").to_pydict()
    columns = (table["topic"], [stamp - 7 * 10**9 for stamp in table["stamp"]], table["joint"])
    assert list(zip(*columns, table["position"], table["velocity"], strict=True)) == STRANGE
    assert set(table["effort"]) == {None}
    assert main(["export", str(kept / "firm"), "--parquet", "firm.parquet"]) == 0
    run, table = read_run(kept / "firm"), parquet.read_table(folder / "firm.parquet")
    np.testing.assert_array_equal(table["time"].to_numpy(), run.time)
    np.testing.assert_array_equal(table["effort.joint2"].to_numpy(), run.effort[:, 1])


def test_without_pyarrow_it_shows_how_to_get_it(
    strange: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["export", str(strange), "--parquet", "strange.parquet"]) == 2
    assert "requirements/parquet.lock" in capsys.readouterr().err
    assert not (folder / "strange.parquet").exists()
    assert main(["export", str(strange)]) == 2
    assert "--csv or --parquet" in capsys.readouterr().err


def test_a_table_of_a_run_has_a_description_beside_it(strange: Path, kept: Path, folder: Path) -> None:
    assert main(["export", str(kept / "firm"), "--csv", "a b.csv"]) == 0
    content = json.loads((folder / "a b.csv-metadata.json").read_text())
    with (folder / "a b.csv").open(newline="") as file:
        assert [column["titles"] for column in content["tableSchema"]["columns"]] == next(csv.reader(file))
    (made,) = content["notes"]
    origin = json.loads((kept / "firm" / "run.json").read_text())
    assert content["url"] == "a%20b.csv"
    assert [made[key] for key in ("pidtsm", "commit", "command", "seed")] == [
        origin[key] for key in ("version", "commit", "command", "seed")
    ]
    assert made["gains"]["law.k1"] == 4.0
    assert main(["export", str(strange), "--csv", "strange.csv"]) == 0
    assert not (folder / "strange.csv-metadata.json").exists(), "nobody knows what made it"
