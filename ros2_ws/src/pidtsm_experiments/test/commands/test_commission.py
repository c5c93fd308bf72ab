"""``./pidtsm commission``: a whole session on a simulated arm, and what is refused."""

import json
from pathlib import Path

import pytest

from pidtsm_core.experiment import make_experiment
from pidtsm_core.robots.description import read_description
from pidtsm_experiments.bags.measurements import read_measurement
from pidtsm_experiments.cli import main

TWO_LINK = str(Path(__file__).parents[3] / "two_link_sim/urdf/two_link.urdf")
ARM = ["--robot", TWO_LINK, "--effort", "120,80", "--plant", "--yes"]
TRUTH = {
    "rate": 500,
    "encoder.bits": 17,
    "delay.samples": 1,
    "friction.coulomb": 0.8,
    "robot.armature": 0.5,
    "model_error.mass": 0.2,
    "model_error.inertia": 0.2,
    "initial_position": "[0.4,0.6]",
}
SET = [word for name, value in TRUTH.items() for word in ("--set", f"simulator.{name}={value}")]


def test_a_session_finds_what_is_wrong_and_leaves_parameters_that_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "session"
    words = ["commission", *ARM, *SET, "--invert", "joint2", "--out", str(out)]
    assert main(words) == 0
    said = capsys.readouterr().err
    assert "the sign of joint2 is inverted" in said
    found = {name: each["figures"] for name, each in json.loads((out / "session.json").read_text())["found"].items()}
    assert max(found["signs"]["moved"]) < 0.02
    assert (found["rest"]["rate"], found["rest"]["bits"]) == (pytest.approx(500.0), 17)
    assert found["lateness"]["delay"] == pytest.approx(0.002, abs=0.002)
    assert found["friction"]["coulomb"] == pytest.approx([0.8, 0.8], rel=0.2)
    assert found["gravity"]["share"] == pytest.approx([0.2, 0.2], abs=0.03)
    identified = found["identify"]["parameters"]
    assert identified["compensation.coulomb"] == pytest.approx([0.8, 0.8], rel=0.05)
    assert identified["robot.armature"] == pytest.approx([0.6, 0.6], rel=0.2)  # An inertia, so 20 % more.
    assert found["compare"]["better"]
    assert found["compare"]["ratio"] < 0.5
    # What it leaves can be used.
    assert read_description((out / "commissioned.urdf").read_text()).joints == ("joint1", "joint2")
    settings = make_experiment(None, params=str(out / "commission.yaml")).settings["controller"]
    assert settings["robot.description"] == str(out / "commissioned.urdf")
    assert settings["estimator.bandwidth"] == pytest.approx(found["gains"]["bandwidth"], rel=0.05)
    assert "plausibility.velocity" not in settings, "once the model is known, a broken encoder must show again"
    assert "Gravity" in (out / "report.html").read_text()
    measured, source = read_measurement(out / "bags" / "identify")
    assert measured.joints == ("joint1", "joint2")
    assert "joint_commands" in source
    assert main(words) == 2
    assert "every step is done" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--robot", "scara", "--yes"], "--yes is for simulated arms"),
        (["--robot", "scara", "--invert", "joint1"], "--invert is for simulated arms"),
        (["--robot", "scara", "--plant", "--invert", "elbow"], "--invert elbow: must be JOINT"),
        (["--robot", "scara", "--plant"], "somebody must agree"),
        (["--robot", "scara", "--release"], "nothing holds an arm"),
        (["--robot", "scara", "--plant", "--scene", "absent.xml"], "--scene absent.xml: no such file"),
    ],
)
def test_what_would_move_an_arm_without_consent_is_refused(
    words: list[str], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["commission", *words, "--out", str(tmp_path / "session")]) in (1, 2)
    assert reason in capsys.readouterr().err
