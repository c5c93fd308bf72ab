"""``./pidtsm gains``: a parameter file that commands and nodes take."""

import json
from pathlib import Path

import pytest
from rclpy.parameter import parameter_dict_from_yaml_file

from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.gains import first_gains
from pidtsm_experiments.cli import main
from pidtsm_experiments.runs.origin import comment

SCARA = {"robot.description": "scara"}


def test_the_file_has_the_gains_with_their_reasons(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "gains.yaml"
    assert main(["gains", "--robot", "scara", "--encoder-bits", "17", "--delay", "4", "--out", str(file)]) == 0
    text = file.read_text(encoding="utf-8")
    assert capsys.readouterr().out == text
    assert text.startswith(comment())
    gains = first_gains(SCARA, 17, 0.004)
    for gain in gains:
        assert gain.reason in " ".join(line.strip().removeprefix("# ") for line in text.splitlines())
    experiment = make_experiment(None, robot="scara", params=[str(file)])
    expected = {g.name: list(g.value) if isinstance(g.value, tuple) else g.value for g in gains}
    assert {name: experiment.settings["controller"][name] for name in expected} == expected
    assert set(parameter_dict_from_yaml_file(str(file))) == set(expected)


def test_a_program_reads_values_and_reasons(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gains", "--robot", "scara", "--json"]) == 0
    read = json.loads(capsys.readouterr().out)
    assert {name: entry["reason"] for name, entry in read.items()} == {g.name: g.reason for g in first_gains(SCARA)}


def test_those_for_a_class_of_hardware_are_those_of_an_experiment_with_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gains", "--robot", "scara", "--hardware", "geared", "--json"]) == 0
    shown = {name: entry["value"] for name, entry in json.loads(capsys.readouterr().out).items()}
    used = make_experiment(None, robot="scara", hardware="geared").settings["controller"]
    assert {name: list(value) if isinstance(value := used[name], tuple) else value for name in shown} == shown


@pytest.mark.parametrize(
    ("words", "cause"),
    [
        (["--hardware", "geared", "--rate", "100"], "has its own resolution, delay and rate"),
        (["--encoder-bits", "41"], "must be from 0 to 40"),
        (["--delay", "-1"], "must be from 0 to 1000 ms"),
        (["--delay", "nan"], "must be from 0 to 1000 ms"),
        (["--rate", "0"], "must be from 1 to 100000 Hz"),
        (["--robot", "pandda"], "did you mean panda?"),
        (["--robot", "topic"], "works in nodes only"),
        (["--out", "nowhere/gains.yaml"], "No such file or directory"),
    ],
)
def test_bad_input_is_one_line(words: list[str], cause: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gains", *words]) == 2
    err = capsys.readouterr().err
    assert cause in err
    assert err.count("\n") == 1
