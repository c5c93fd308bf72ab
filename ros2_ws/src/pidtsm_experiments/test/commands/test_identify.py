"""``./pidtsm excite`` and ``identify``: from an arm to a motion, and from a bag to a better description."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from support.knownarm import KnownArm, known_arm
from support.randomtree import random_tree

from pidtsm_core.identification.identification import identify
from pidtsm_core.identification.measurement import Measurement
from pidtsm_core.parameters.files import load_ros_parameters
from pidtsm_core.robots.description import read_description
from pidtsm_core.rollouts.closed_loop import rollout
from pidtsm_experiments.bags.message_types import typestore
from pidtsm_experiments.bags.topics import SENSORS
from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.origin import comment, origin_of
from pidtsm_studies.identification.report import write_identification_report


def write_joint_states(measured: Measurement, folder: Path, efforts: bool = True) -> None:
    """A bag as another controller records it."""
    store = typestore()
    types = store.types
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topic = bag.add_connection("/arm/joint_states", SENSORS.msgtype, typestore=store)
        for time, q, effort in zip(measured.time, measured.position, measured.effort, strict=True):
            stamp = round(time * 1e9) + 10**18
            header = types["std_msgs/msg/Header"](
                types["builtin_interfaces/msg/Time"](*divmod(stamp, 1_000_000_000)), ""
            )
            given = effort if efforts else np.empty(0)
            message = types[SENSORS.msgtype](header, list(measured.joints), q, np.empty(0), given)
            bag.write(topic, stamp, store.serialize_cdr(message, SENSORS.msgtype))


@pytest.fixture(scope="module")
def known() -> KnownArm:
    return known_arm("two_link", duration=20.0)


@pytest.fixture(scope="module")
def folder(known: KnownArm, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag, the wrong description of its arm, and the result."""
    parent = tmp_path_factory.mktemp("identify")
    write_joint_states(known.measured, parent / "bag")
    (parent / "arm.urdf").write_text(known.described.text, encoding="utf-8")
    words = [str(parent / "bag"), "--robot", str(parent / "arm.urdf"), "--out", str(parent / "result")]
    assert main(["identify", *words]) == 0
    return parent


def test_the_result_is_an_arm_for_controller_and_simulator(known: KnownArm, folder: Path) -> None:
    result = json.loads((folder / "result/identification.json").read_text(encoding="utf-8"))
    origin = origin_of(folder / "result")
    assert origin is not None
    assert origin["runs"] == {str(folder / "bag"): None}, "a bag of somebody does not name where it comes from"
    errors = result["torque_error"]
    assert (np.array(errors["after"]) < 0.2 * np.array(errors["before"])).all()
    np.testing.assert_allclose(result["coulomb"], known.truth[24:26], rtol=0.05)
    arm = read_description((folder / "result/identified.urdf").read_text(encoding="utf-8"))
    np.testing.assert_allclose(arm.friction, result["coulomb"], rtol=1e-6)
    parameters = load_ros_parameters(folder / "result/identified.yaml")
    assert parameters["controller"]["compensation.coulomb"] == pytest.approx(result["coulomb"])
    assert parameters["controller"]["compensation.offset"] == pytest.approx(result["offset"])
    assert parameters["simulator"]["friction.offset"] == pytest.approx(result["offset"])
    np.testing.assert_allclose(result["offset"], known.truth[26:28], atol=0.1)
    np.testing.assert_allclose(errors["as_written"], errors["after"], rtol=0.01)
    urdf = str(folder / "result/identified.urdf")
    assert parameters["simulator"]["robot.description"] == urdf
    run = rollout(robot=urdf, params=[str(folder / "result/identified.yaml"), "practical"], duration=0.5)
    assert np.abs(run.error).max() < 0.01


def test_what_the_arm_carried_is_a_part_of_the_result(folder: Path, tmp_path: Path) -> None:
    """So the parameter file has no payload."""
    words = [str(folder / "bag"), "--robot", str(folder / "arm.urdf"), "--payload", "0.1", "--effort", "90,40"]
    assert main(["identify", *words, "--out", str(tmp_path / "loaded")]) == 0
    before = [
        json.loads((each / "identification.json").read_text("utf-8"))["torque_error"]["before"]
        for each in (folder / "result", tmp_path / "loaded")
    ]
    assert before[0] != before[1]
    for values in load_ros_parameters(tmp_path / "loaded/identified.yaml").values():
        assert values["payload.mass"] == 0.0
        assert values["limits.effort"] == [90.0, 40.0]


def test_a_description_that_is_right_is_called_right(known: KnownArm, tmp_path: Path) -> None:
    found = identify(known.described, [known.measured])
    exact = replace(found, check=replace(found.check, before=found.check.measured))
    verdicts = []
    for each in (found, exact):
        write_identification_report(tmp_path / "page.html", each, "arm")
        verdicts.append((tmp_path / "page.html").read_text(encoding="utf-8").partition('class="verdict')[2])
    assert ["The description is right" in verdict.partition("</p>")[0] for verdict in verdicts] == [False, True]


def test_the_page_shows_torques_parameters_and_what_is_unknown(folder: Path) -> None:
    page = (folder / "result/identification.html").read_text(encoding="utf-8")
    ids = re.findall(r' id="([^"]+)"', page.partition("<script>")[0])
    assert len(ids) == len(set(ids)) > 5
    for text in (
        "/arm.urdf</h1>",
        "data kept apart",
        "the files, read back",
        "joint1.Izz",
        "joint1.my",
        "No motion of this arm shows",
    ):
        assert text in page


@pytest.mark.parametrize(
    ("words", "cause"),
    [
        (["nowhere"], "no such file or folder"),
        (["bag", "--robot", "panda"], "the joint states lack panda_joint1"),
        (["bag", "--robot", "arm.urdf", "--out", "."], "the current folder"),
        (["silent", "--robot", "arm.urdf"], "0 values of effort for 2 joints"),
    ],
)
def test_bad_input_is_named(
    folder: Path,
    known: KnownArm,
    words: list[str],
    cause: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    if words[0] == "silent":
        write_joint_states(known.measured.between(0.0, 0.1), folder / "silent", efforts=False)
    assert main(["identify", *words, *([] if "--robot" in words else ["--robot", "two_link"])]) == 2
    assert cause in capsys.readouterr().err
    assert not (folder / "results").exists()


def test_a_motion_that_is_too_short_is_named_with_the_command_that_makes_a_better_one(
    known: KnownArm, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_joint_states(known.measured.between(0.0, 0.15), tmp_path / "short")
    arm = str(folder / "arm.urdf")
    assert main(["identify", str(tmp_path / "short"), "--robot", arm, "--out", str(tmp_path / "result")]) == 2
    cause = capsys.readouterr().err
    assert "record at least 20 s" in cause
    assert f"./pidtsm excite --robot {arm} --duration 60 --out motion.yaml makes such a motion" in cause
    assert not (tmp_path / "result").exists()


def test_terminal_json_and_page_agree_on_a_lift(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lift = random_tree(1, "p", "z")
    write_joint_states(lift.measured, tmp_path / "bag")
    (tmp_path / "lift.urdf").write_text(lift.described.text, encoding="utf-8")
    words = [str(tmp_path / "bag"), "--robot", str(tmp_path / "lift.urdf"), "--out", str(tmp_path / "result")]
    assert main(["identify", *words, "--json"]) == 0
    out, err = capsys.readouterr()
    (note,) = json.loads(out)["notes"]
    assert note.startswith("j0: no motion tells mass, armature and offset apart: ")
    assert f"pidtsm: note: {note}" in err
    assert note in (tmp_path / "result/identification.html").read_text(encoding="utf-8")


def test_an_exciting_motion_is_a_scenario_within_the_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["--robot", "two_link", "--duration", "10", "--set", "trajectory.limits.velocity=0.5"]
    assert main(["excite", *words, "--out", "motion.yaml"]) == 0
    assert Path("motion.yaml").read_text(encoding="utf-8").startswith(comment())
    run = rollout("motion.yaml", duration=10.0)
    assert np.abs(run.reference[:, 1]).max() <= 0.5
    assert np.ptp(run.reference[:, 0], axis=0).min() > 0.5
    np.testing.assert_allclose(run.reference[0, 1:], 0.0, atol=1e-6)
    assert np.abs(run.error).max() < 0.05


def test_the_name_of_the_scenario_is_checked(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["excite", "--robot", "two_link", "--out", "motion.csv"]) == 2
    assert "must end with .yaml" in capsys.readouterr().err


def test_a_payload_is_found_in_the_bag_of_a_rollout(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of the simulated arm, whose bag has its ground truth."""
    words = ["--robot", "ur5", "--duration", "8", "--params", "practical"]
    carried = ["--set", "simulator.payload.mass=2.0", "--set", "simulator.payload.center_of_mass=[0.0,0.05,0.1]"]
    assert main(["rollout", *words, *carried, "--bag", "--out", str(tmp_path / "run")]) == 0
    capsys.readouterr()
    file = tmp_path / "payload.yaml"
    assert main(["identify-payload", str(tmp_path / "run/bag"), "--robot", "ur5", "--json", "--out", str(file)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["mass"] == pytest.approx(2.0, rel=0.02)
    np.testing.assert_allclose(found["center_of_mass"], [0.0, 0.05, 0.1], atol=0.005)
    assert load_ros_parameters(file)["controller"]["payload.mass"] == found["mass"]
    assert file.read_text(encoding="utf-8").startswith(comment())
