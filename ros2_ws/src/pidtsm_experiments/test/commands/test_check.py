"""``./pidtsm check``: tables, page and JSON of an arm, and exit codes that show whether it looks right."""

import json
import re
from pathlib import Path

import pytest

from pidtsm_core.robots.source import read_source
from pidtsm_experiments.cli import main


def arm(folder: Path, old: str = "", new: str = "") -> Path:
    """The file of a SCARA, with a change."""
    text = read_source("scara")[1]
    assert old in text
    file = folder / "arm.urdf"
    file.write_text(text.replace(old, new), encoding="utf-8")
    return file


def test_a_sound_arm_is_shown_with_its_joints_and_loads(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "scara"]) == 0
    shown, messages = capsys.readouterr()
    assert messages == ""
    assert max(map(len, shown.splitlines())) <= 100
    assert re.search(r"joint3 +prismatic +0 0 1 +-0\.18 to 0 +1\.1", shown)
    assert re.search(r"joint3 +150 +12\.8 +9 % +5\.8 +4\.5 +20 +12", shown)
    assert "nothing looks like a mistake" in shown


def test_a_doubt_has_file_line_element_and_cure(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = arm(folder, 'lower="-2.6" upper="2.6"', 'lower="-149" upper="149"')
    assert main(["check", str(file), "--html", "arm.html"]) == 1
    shown, messages = capsys.readouterr()
    line = 1 + file.read_text(encoding="utf-8").splitlines().index('  <joint name="joint2" type="revolute">')
    doubt = (
        f"{file}:{line}: joint joint2: its limits are -149 to 149 rad, 23.7 turns; write radians, if these are degrees"
    )
    assert doubt in shown
    assert messages == "arm.html\n"
    page = (folder / "arm.html").read_text(encoding="utf-8")
    assert f"<small>{file}:{line}</small>" in page
    assert page.count("<svg") == 3
    assert page.count("<rect") == 3  # the sliding joint, once in each view


def test_an_arm_that_cannot_be_used_is_refused_in_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = arm(folder, 'lower="-2.6" upper="2.6"', 'lower="2.6" upper="-2.6"')
    assert main(["check", str(file), "--html", "arm.html"]) == 2
    shown, messages = capsys.readouterr()
    assert "joint joint2: lower of its limit, 2.6, is not below upper, -2.6; swap them" in messages
    assert "cannot be used" in shown
    assert "cannot be used" in (folder / "arm.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("change", "code"), [(("", ""), 0), (('velocity="11"', 'velocity="0"'), 1), (("<link", "<lin"), 2)]
)
def test_a_program_reads_the_same(
    change: tuple[str, str], code: int, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = arm(folder, *change)
    assert main(["check", str(file), "--json"]) == code
    read = json.loads(capsys.readouterr().out)
    assert read["file"] == str(file)
    assert read["usable"] is (code < 2)
    assert [doubt["name"] for doubt in read["doubts"]] == (["joint2"] if code == 1 else [])
    if code < 2:
        assert [joint["name"] for joint in read["joints"] if joint["role"] == "used"] == [
            load["joint"] for load in read["loads"]
        ]
    assert list(folder.iterdir()) == [file]


def test_the_rate_decides_whether_a_joint_is_too_light(folder: Path) -> None:
    file = arm(folder, '<dynamics damping="0.005" friction="0.08"/>', '<dynamics damping="8" friction="0.08"/>')
    assert main(["check", str(file), "--rate", "1000"]) == 0
    assert main(["check", str(file), "--rate", "500"]) == 1


def test_a_closed_form_has_a_picture_too(folder: Path) -> None:
    assert main(["check", "two_link", "--html", "arm.html"]) == 0
    assert (folder / "arm.html").read_text(encoding="utf-8").count("<svg") == 3


@pytest.mark.parametrize(
    ("words", "messages"),
    [
        ([], "the following arguments are required: ROBOT"),
        (["pandda"], "did you mean panda?"),
        (["topic"], "works in nodes only"),
        (["scara", "--rate", "0"], "must be from 1 to 100000 Hz"),
        (["scara", "--html", "nowhere/arm.html"], "No such file or directory"),
    ],
)
def test_bad_input_is_one_line(words: list[str], messages: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", *words]) == 2
    err = capsys.readouterr().err
    assert messages in err
    assert err.count("\n") == 1
