"""``./pidtsm check-gains``: its exit code, what a program reads, and the gains of a finished run."""

import json
from pathlib import Path

import pytest

from pidtsm_experiments.cli import main

BAD = ["--set", "controller.law.kp=0", "--set", "controller.law.ki=0"]


def test_a_good_set_is_told_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-gains", "--duration", "0.5"]) == 0
    out = capsys.readouterr().out
    assert "no condition is violated" in out
    assert "roots" in out
    assert "V, eq. (35): " in out
    assert "not covered: finite time, Theorem 1: " in out


def test_a_violated_condition_is_named_with_its_cure(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-gains", "--duration", "0.5", *BAD]) == 1
    assert "violated: manifold, eq. (10): set law.kp, law.ki and law.kd above 0" in capsys.readouterr().out


def test_a_program_reads_everything(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-gains", "--robot", "scara", "--duration", "0.5", "--json"]) == 0
    read = json.loads(capsys.readouterr().out)
    assert read["holds"]
    assert len(read["bounds"]["gain_needed"]) == len(read["joints"]) == 4


def test_the_gains_of_a_run_are_checked_along_it(folder: Path, kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-gains", "--run", str(kept / "firm"), "--json", "--out", "checked"]) == 0
    text = capsys.readouterr().out
    assert json.loads(text)["conditions"][0]["values"]["K1"] == [4.0, 4.0]
    assert (folder / "checked" / "check.json").read_text(encoding="utf-8") == text
    assert (folder / "checked" / "figures" / "phase.png").is_file()
    assert (folder / "checked" / "run.json").is_file()


def test_a_law_without_a_sliding_variable_has_conditions_only(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--law", "pid", "--duration", "0.1", "--set", "controller.law.ki=9000", "--out", "checked"]
    assert main(["check-gains", *words]) == 1
    out = capsys.readouterr().out
    assert "no bounds: pid has no sliding variable" in out
    assert "violated: loop, Astrom 2006: " in out
    assert not (folder / "checked" / "figures").exists()


def test_a_rollout_warns_of_what_is_violated_and_of_nothing_else(capsys: pytest.CaptureFixture[str]) -> None:
    main(["rollout", "--duration", "0.1", *BAD])
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("pidtsm: warning: law piddtsm: manifold, eq. (10): set law.kp")
    main(["rollout", "--duration", "0.1"])
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("words", "cause"),
    [
        (["--run", "nowhere"], "nowhere: no such file or folder"),
        (["--run", "{kept}/firm", "--law", "dtsm"], "--run has its own parameters; omit --law"),
        (["--set", "controller.law.kp=-1"], "must be >= 0"),
        (["--law", "pidtsm"], "unknown law pidtsm"),
    ],
)
def test_bad_input_is_one_line(words: list[str], cause: str, kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-gains", *(word.replace("{kept}", str(kept)) for word in words)]) == 2
    err = capsys.readouterr().err
    assert cause in err
    assert err.count("\n") == 1
