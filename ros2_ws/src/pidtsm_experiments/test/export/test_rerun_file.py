"""Files for rerun, judged by rerun's own reader and command; it is optional."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.robots.source import read_source
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.cli import main

OPTIONAL = "rerun-sdk is optional (requirements/rerun.lock)"
ARMS = ("panda", "scara")


@pytest.fixture(scope="session")
def shown(bags: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the exported file of each arm; do not change it."""
    pytest.importorskip("rerun", reason=OPTIONAL)
    folder = tmp_path_factory.mktemp("shown")
    for arm in ARMS:
        assert main(["export", str(bags / arm), "--rerun", "--out", str(folder / f"{arm}.rrd")]) == 0
    return folder


def columns(file: Path) -> dict[str, dict[str, Any]]:
    """Columns that change in time, by entity, as rerun reads them."""
    from rerun.chunk import RrdReader

    found: dict[str, dict[str, Any]] = {}
    for chunk in RrdReader(file).stream():
        if not chunk.is_static:
            found.setdefault(chunk.entity_path, {}).update(chunk.to_record_batch().to_pydict())
    return found


def time_of(values: dict[str, Any]) -> Array:
    """Times of the rows, ns."""
    return np.array(values["time"], dtype="timedelta64[ns]").astype(np.int64)


@pytest.mark.parametrize("arm", ARMS)
def test_curves_are_those_of_the_bag_to_the_last_bit(bags: Path, shown: Path, arm: str) -> None:
    run, found = read_recording(bags / arm), columns(shown / f"{arm}.rrd")
    arrays = run.arrays()
    for quantity in ("position", "reference", "error", "effort"):
        for j, joint in enumerate(run.joints):
            values = found[f"/{quantity}/{joint}"]
            np.testing.assert_array_equal(time_of(values), run.stamps_ns - run.stamps_ns[0])
            np.testing.assert_array_equal(np.ravel(values["Scalars:scalars"]), arrays[quantity][:, j])


@pytest.mark.parametrize("arm", ARMS)
def test_links_are_where_mujoco_puts_them(bags: Path, shown: Path, arm: str) -> None:
    run, found = read_recording(bags / arm), columns(shown / f"{arm}.rrd")
    asked = '<mujoco><compiler fusestatic="false" discardvisual="true"/></mujoco></robot>'
    model = mujoco.MjModel.from_xml_string(read_source(arm)[1].replace("</robot>", asked))
    data = mujoco.MjData(model)
    link = model.body(model.nbody - 1).name
    for name, positions in (("arm", run.position), ("reference", run.desired)):
        values = found[f"/scene/{name}/{link}"]
        times = time_of(values)
        assert times.size == 10, "50 a second"
        for time, place in zip(times, values["Transform3D:translation"], strict=True):
            for joint, q in zip(run.joints, positions[run.stamps_ns - run.stamps_ns[0] == time][0], strict=True):
                data.qpos[model.joint(joint).qposadr[0]] = q
            mujoco.mj_kinematics(model, data)
            np.testing.assert_allclose(np.ravel(place), data.xpos[-1], atol=1e-6)  # rerun's places are float32.


def test_rerun_reads_it_with_shapes_and_what_it_shows_at_first(shown: Path) -> None:
    from rerun.chunk import RrdReader

    file = shown / "panda.rrd"
    checked = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(file)], capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stderr
    reader = RrdReader(file)
    assert [entry.recording_id for entry in reader.recordings()] == ["panda"]
    assert len(reader.blueprints()) == 1
    shapes = {
        chunk.entity_path.split("/")[2]
        for chunk in reader.stream()
        if "Cylinders3D:lengths" in chunk.to_record_batch().schema.names
    }
    assert shapes == {"arm", "reference"}


def test_rerun_plays_the_file_for_foxglove(bags: Path, folder: Path) -> None:
    """Its reader of MCAP files is another one than Foxglove's; it draws the description and moves it by tf."""
    pytest.importorskip("rerun", reason=OPTIONAL)
    from rerun.chunk import McapReader

    assert main(["export", str(bags / "panda"), "--foxglove", "--out", "panda.mcap"]) == 0
    moved: set[str] = set()
    drawn: set[str] = set()
    for chunk in McapReader("panda.mcap").stream():
        rows = chunk.to_record_batch().to_pydict()
        moved |= {frame for frames in rows.get("Transform3D:child_frame", []) for frame in frames}
        if "Cylinders3D:lengths" in rows:
            drawn.add(chunk.entity_path.split("/")[-2])
    links = {f"panda_link{i}" for i in range(8)}
    assert drawn == links
    assert links | {f"reference/{link}" for link in links} <= moved


def test_what_happened_is_a_log(leave: Any, folder: Path) -> None:
    pytest.importorskip("rerun", reason=OPTIONAL)
    push = ("time=0.1", "duration=0.05", "effort=[5.0,0.0]")
    leave(folder / "pushed", None, 0.3, tuple(f"simulator.push.{each}" for each in push), bag=False)
    assert main(["export", "pushed", "--rerun"]) == 0
    log = columns(folder / "pushed.rrd")["/events"]
    pushes = [k for k, text in enumerate(log["TextLog:text"]) if "is pushed" in text[0]]
    assert [(log["TextLog:level"][k], time_of(log)[k]) for k in pushes] == [(["WARN"], 100_000_000)]


def test_without_rerun_it_says_how_to_get_it(
    bags: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["export", str(bags / "scara"), "--rerun", "--out", "scara.rrd"]) == 2
    error = capsys.readouterr().err
    assert "requirements/rerun.lock" in error
    assert error.count("\n") == 1
    assert not [*folder.iterdir()]
