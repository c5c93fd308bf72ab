"""The table is readable without a terminal and marks values that do not exist."""

import io
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from pidtsm_core.recording import Recording
from pidtsm_experiments.bags.analysis import analyze
from pidtsm_experiments.commands.table import metrics_table, print_metrics


@pytest.fixture
def values(tmp_path: Path, run: Recording, write_bag: Any) -> dict[str, Any]:
    return analyze(write_bag(tmp_path / "bag", run))


def printed(values: dict[str, Any], width: int = 80) -> list[str]:
    text = io.StringIO()
    print_metrics(values, Console(file=text, width=width))
    assert "\x1b" not in text.getvalue()
    return text.getvalue().splitlines()


def columns(values: dict[str, Any], width: int = 300) -> dict[str, list[str]]:
    """Cells by heading and unit; the first is that of the joints."""
    table = metrics_table(values, width)
    return {str(column.header).replace("\n", " "): [str(cell) for cell in column.cells] for column in table.columns}


def test_there_is_one_row_per_joint_with_units_and_a_verdict(values: dict[str, Any]) -> None:
    lines = printed({**values, "rmse": [0.0379512, 1.234e-5], "steady_state_error": [1e-4, 2.5e-3]})
    assert lines[0].strip() == "case1, piddtsm, lockstep: 2 s, 2000 samples"
    (joint1,), (joint2,) = ([line.split() for line in lines if line.strip().startswith(f"joint{n}")] for n in (1, 2))
    assert (joint1[2], joint2[2]) == ("0.03795", "1.234e-05")
    assert next(line.split() for line in lines if line.strip().startswith("joint "))[:3] == ["joint", "rad", "rad"]
    assert lines[-1] == "followed; within 2.5\u202fmrad over the last 40\u202f% (joint2)"


def test_a_joint_at_a_limit_of_its_effort_is_in_the_verdict(values: dict[str, Any]) -> None:
    lines = printed({**values, "saturation": [0.05, 0.4], "steady_state_error": [1e-4, 2e-5]}, width=200)
    limited = "joint2 was at a limit of its effort 40 % of the time"
    assert lines[-1] == f"followed, but {limited}; within 100\u202fµrad over the last 40\u202f% (joint1)"


SEVEN = [f"panda_joint{j}" for j in range(1, 8)]


def of_joints(values: dict[str, Any], joints: list[str], slides: list[bool]) -> dict[str, Any]:
    """The metrics with other joints, which have the same values in turn."""
    per_joint = {key: (value * 4)[: len(joints)] for key, value in values.items() if isinstance(value, list) and value}
    return {**values, **per_joint, "joints": joints, "slides": slides}


def test_sliding_joints_have_their_own_units(values: dict[str, Any]) -> None:
    found = columns(of_joints(values, ["a", "b", "c"], [False, True, False]))
    assert found["units"] == ["rad, N m", "m, N", "rad, N m"]
    assert "RMSE" in found
    alike = columns(of_joints(values, ["a", "b"], [True, True]))
    assert "units" not in alike
    assert {"RMSE m", "mean effort N", "variation rate N/s", "settling s"} <= {*alike}


@pytest.mark.parametrize("joints", [["j"], ["a_joint_with_a_long_name", "b"], SEVEN])
@pytest.mark.parametrize("width", [20, 80, 120, 300])
def test_the_table_fits_and_has_a_row_for_each_joint(values: dict[str, Any], joints: list[str], width: int) -> None:
    longest = {key: [-1.234e-05] * 2 for key in ("max_error", "rmse", "torque_variation_rate", "adaptive_gain")}
    for slides in ([False] * len(joints), [True] + [False] * (len(joints) - 1)):
        for outcome in ("followed", "ran away"):
            shown = {**of_joints({**values, **longest}, joints, slides), "outcome": outcome}
            table = metrics_table(shown, width)
            assert table.row_count == len(joints)
            assert Console(width=500).measure(table).maximum <= max(width, 50)
            assert any(str(column.header).startswith("largest error") for column in table.columns[:3])


def test_the_limit_is_in_percent_of_the_time(values: dict[str, Any]) -> None:
    assert columns({**values, "saturation": [0.0125, 0.0]})["at limit %"] == ["1.25", "0"]


def test_values_that_do_not_exist_are_a_dash(values: dict[str, Any]) -> None:
    unknown = {**values, "settling_time": [None, 2.5], "scenario": None, "law": None, "clock": None}
    assert columns(unknown)["settling s"] == ["-", "2.5"]
    assert printed(unknown)[0].strip() == "2 s, 2000 samples"


def test_recovery_time_only_with_an_event(values: dict[str, Any]) -> None:
    assert "recovery s" not in columns(values)
    assert columns({**values, "recovery_time": [0.25, None]})["recovery s"] == ["0.25", "-"]


FAULT = {"fault": "tracking_limit", "time": 0.123, "joint": "joint1", "reset": None}


def test_events_are_printed_and_then_the_verdict(values: dict[str, Any]) -> None:
    rejected = {"controller": 3, "simulator": 0}
    lines = printed({**values, "outcome": "stopped", "faults": [FAULT], "time_stopped": 1.877, "rejected": rejected})
    assert lines[-4:] == [
        "does not follow at the end: stopped, with the safe torque",
        "stopped for 1.877 s of 2 s",
        "messages rejected: controller 3",
        "stopped at 0.123 s: joint1 is beyond limits.tracking_error",
    ]


def test_a_run_that_ran_away_has_no_errors_to_compare(values: dict[str, Any]) -> None:
    found = columns({**values, "outcome": "ran away"})
    for heading in ("largest error rad", "RMSE rad", "mean effort N m", "steady error rad"):
        assert ["ran away" in cell for cell in found[heading]] == [True, True]
    assert printed({**values, "outcome": "ran away"})[-1].startswith(
        "ran away: a joint was more than 3.14 rad from its"
    )


def test_times_at_limits_are_shown_if_there_are_any(values: dict[str, Any]) -> None:
    none = {"time_at_effort_limit": [0.0, 0.0], "time_at_rate_limit": [0.0, 0.0]}
    assert not {"effort limit s", "rate limit s"} & {*columns({**values, **none})}
    found = columns({**values, **none, "time_at_rate_limit": [0.0, 0.25]})
    assert found["rate limit s"] == ["0", "0.25"]
    assert "effort limit s" not in found


def test_lost_stamps_are_printed(values: dict[str, Any]) -> None:
    assert "incomplete" not in "".join(printed(values))
    lost = {**values["lost"], "reference": 3}
    assert "incomplete recording, missing messages: reference 3" in printed({**values, "lost": lost})


def test_only_nodes_have_a_compute_time(values: dict[str, Any]) -> None:
    assert any("compute time 20 / 20 / 20 us" in line for line in printed(values))
    timing = {**values["timing"], "compute_time": {"p50": None, "p99": None, "max": None}}
    assert "compute time" not in "".join(printed({**values, "timing": timing}))


def test_joint_names_are_not_markup(values: dict[str, Any]) -> None:
    assert any(line.strip().startswith("[bold] ") for line in printed({**values, "joints": ["[bold]", "b"]}))
