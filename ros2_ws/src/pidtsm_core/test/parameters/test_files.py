"""Parameter files: what ROS reads, and nothing that is silently lost."""

from pathlib import Path

import pytest

from pidtsm_core.errors import UsageError
from pidtsm_core.experiment import make_experiment
from pidtsm_core.parameters.files import load_ros_parameters, ros_parameters
from pidtsm_core.recording.metrics import finite

SECTION = "{}:\n  ros__parameters:\n    {}\n"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            SECTION.format("/**/controller", "rate: 500") + SECTION.format("controller", "rate: 400"),
            "/**/controller in line 1 and controller in line 4 are both of controller; join them",
        ),
        (
            SECTION.format("controller", "rate: 500") + SECTION.format("controller", "rate: 400"),
            "controller is given twice, in lines 1 and 4",
        ),
        (SECTION.format("controller", "law: {kappa: 1.0, kappa: 2.0}"), "kappa is given twice, in lines 3 and 3"),
        (
            SECTION.format("controller", "law.kappa: 1.0\n    law:\n      kappa: 2.0"),
            "law.kappa is given twice, in lines 3 and 5",
        ),
        (SECTION.format("controller", "law:\n      kappa: 1.0\n    law: {upsilon: 1.0}"), "law is given twice, in"),
    ],
    ids=["sections", "same section", "key", "dots and group", "group"],
)
def test_what_is_given_twice_is_refused_with_both_lines(tmp_path: Path, text: str, reason: str) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(UsageError) as refused:
        load_ros_parameters(file)
    assert str(refused.value).startswith(f"{file}: ")
    assert reason in str(refused.value)


def test_sections_and_groups_that_differ_are_all_kept(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(
        "\ufeff"
        + SECTION.format("/**/controller", "law.kappa: 1.0\n    law:\n      upsilon: 2.0\n    law.m: 3.0")
        + SECTION.format("simulator", "{}")
    )
    assert load_ros_parameters(file) == {
        "controller": {"law.kappa": 1.0, "law.upsilon": 2.0, "law.m": 3.0},
        "simulator": {},
    }
    file.write_text(ros_parameters("controller", {"law.kappa": 1.0, "joints": ("a", "b")}))
    assert load_ros_parameters(file) == {"controller": {"law.kappa": 1.0, "joints": ["a", "b"]}}


def test_a_scenario_with_a_key_twice_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("duration: 1.0\ncontroller:\n  rate: 500\n  rate: 400\n")
    with pytest.raises(UsageError, match=r"mine\.yaml: rate is given twice, in lines 3 and 4"):
        make_experiment(str(file))


@pytest.mark.parametrize("duration", [1e300, 1.1e9, float("inf"), float("nan"), 0.0])
def test_a_run_that_never_ends_is_refused(duration: float) -> None:
    with pytest.raises(UsageError, match="must be a positive number of seconds, at most 1e"):
        make_experiment("case1", duration=duration)


def test_json_has_null_for_numbers_that_it_lacks() -> None:
    assert finite({"rmse": [1.0, float("inf")], "timing": {"rate": float("nan")}, "law": "pid", "samples": 3}) == {
        "rmse": [1.0, None],
        "timing": {"rate": None},
        "law": "pid",
        "samples": 3,
    }
