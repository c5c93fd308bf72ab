"""The table is readable without a terminal and marks values that do not exist."""

import io
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from pidtsm_core.recording import Recording
from pidtsm_experiments.bags.analysis import analyze
from pidtsm_experiments.commands.table import metrics_tables, print_metrics


@pytest.fixture
def values(tmp_path: Path, run: Recording, write_bag: Any) -> dict[str, Any]:
    return analyze(write_bag(tmp_path / "bag", run))


def printed(values: dict[str, Any], width: int = 80) -> list[str]:
    text = io.StringIO()
    print_metrics(values, Console(file=text, width=width))
    assert "\x1b" not in text.getvalue()
    return text.getvalue().splitlines()


def row(lines: list[str], label: str) -> list[str]:
    (line,) = (line for line in lines if line.strip().startswith(label))
    return line.strip().removeprefix(label).split()


def test_there_is_one_column_per_joint_with_units(values: dict[str, Any]) -> None:
    lines = printed({**values, "rmse": [0.0379512, 1.234e-5]})
    assert lines[0].strip() == "case1, piddtsm, lockstep: 2 s, 2000 samples"
    assert row(lines, "metric") == ["unit", "joint1", "joint2"]
    assert row(lines, "RMSE") == ["rad", "0.03795", "1.234e-05"]
    assert row(lines, "effort jumps") == [str(count) for count in values["torque_jumps"]]


SEVEN = [f"panda_joint{j}" for j in range(1, 8)]


def of_joints(values: dict[str, Any], joints: list[str], slides: list[bool]) -> dict[str, Any]:
    """The metrics with other joints, which have the same values in turn."""
    per_joint = {key: (value * 4)[: len(joints)] for key, value in values.items() if isinstance(value, list) and value}
    return {**values, **per_joint, "joints": joints, "slides": slides}


def test_sliding_joints_have_their_units_in_a_table_of_their_own(values: dict[str, Any]) -> None:
    lines = printed(of_joints(values, ["a", "b", "c", "d"], [False, True, False, True]))
    _, turning, sliding = " ".join(" ".join(lines).split()).split("metric unit ")
    assert turning.startswith("a c ")
    assert sliding.startswith("b d ")
    for label, unit, other in (("RMSE", "rad", "m"), ("ECI, mean |effort|", "N m", "N"), ("settling time", "s", "s")):
        assert f" {label} {unit} " in turning
        assert f" {label} {other} " in sliding
    assert " effort variation rate N/s " in sliding
    assert " N m " not in sliding


@pytest.mark.parametrize(("width", "tables"), [(80, 3), (150, 1), (20, 7)])
def test_joints_that_do_not_fit_go_into_further_tables(values: dict[str, Any], width: int, tables: int) -> None:
    made = list(metrics_tables(of_joints(values, SEVEN, [False] * 7), width))
    assert len(made) == tables
    assert [column.header for table in made for column in list(table.columns)[2:]] == SEVEN
    if tables < 7:
        assert max(Console(width=500).measure(table).maximum for table in made) <= width


def test_saturation_is_in_percent(values: dict[str, Any]) -> None:
    assert row(printed({**values, "saturation": [0.0125, 0.0]}), "saturated") == ["%", "1.25", "0"]


def test_values_that_do_not_exist_are_a_dash(values: dict[str, Any]) -> None:
    lines = printed({**values, "settling_time": [None, 2.5], "scenario": None, "law": None, "clock": None})
    assert row(lines, "settling time") == ["s", "-", "2.5"]
    assert lines[0].strip() == "2 s, 2000 samples"


def test_recovery_time_only_with_an_event(values: dict[str, Any]) -> None:
    assert not any("recovery" in line for line in printed(values))
    assert row(printed({**values, "recovery_time": [0.25, None]}), "recovery time") == ["s", "0.25", "-"]


FAULT = {"fault": "tracking_limit", "time": 0.123, "joint": "joint1", "reset": None}


def test_events_are_printed(values: dict[str, Any]) -> None:
    rejected = {"controller": 3, "simulator": 0}
    lines = printed({**values, "outcome": "stopped", "faults": [FAULT], "time_stopped": 1.877, "rejected": rejected})
    assert lines[-4:] == [
        "does not follow at the end: stopped, with the safe torque",
        "stopped at 0.123 s: joint1 is beyond limits.tracking_error",
        "stopped for 1.877 s of 2 s",
        "messages rejected: controller 3",
    ]


def test_a_run_that_ran_away_has_no_errors_to_compare(values: dict[str, Any]) -> None:
    lines = printed({**values, "outcome": "ran away"})
    for label, unit in (("RMSE", "rad"), ("ECI, mean |effort|", "N m"), ("steady-state error", "rad")):
        assert row(lines, label) == [*unit.split(), "ran", "away", "ran", "away"]
    assert lines[-1].startswith("ran away: a joint was more than 3.14 rad from its reference")


def test_times_at_limits_are_printed_if_there_are_any(values: dict[str, Any]) -> None:
    none = {"time_at_effort_limit": [0.0, 0.0], "time_at_rate_limit": [0.0, 0.0]}
    assert not any("limit" in line for line in printed({**values, **none}))
    lines = printed({**values, **none, "time_at_rate_limit": [0.0, 0.25]})
    assert row(lines, "at the rate limit") == ["s", "0", "0.25"]
    assert not any("at the effort limit" in line for line in lines)


def test_two_joints_need_eighty_columns_at_most(values: dict[str, Any]) -> None:
    longest = {key: [-1.234e-05] * 2 for key in ("rmse", "torque_variation_rate", "recovery_time", "adaptive_gain")}
    limits = {"time_at_effort_limit": [0.12345] * 2, "time_at_rate_limit": [0.12345] * 2}
    for outcome in ("followed", "ran away"):
        (table,) = metrics_tables({**values, **longest, **limits, "outcome": outcome})
        assert Console(width=200).measure(table).maximum <= 80


def test_lost_stamps_are_printed(values: dict[str, Any]) -> None:
    assert "incomplete" not in "".join(printed(values))
    lost = {**values["lost"], "reference": 3}
    assert printed({**values, "lost": lost})[-1] == "incomplete recording, missing messages: reference 3"


def test_a_run_without_nodes_has_no_compute_time(values: dict[str, Any]) -> None:
    timing = {**values["timing"], "compute_time": {"p50": None, "p99": None, "max": None}}
    assert "compute time - / - / - us" in printed({**values, "timing": timing})[-1]


def test_joint_names_are_not_markup(values: dict[str, Any]) -> None:
    assert row(printed({**values, "joints": ["[bold]", "b"]}), "metric") == ["unit", "[bold]", "b"]
