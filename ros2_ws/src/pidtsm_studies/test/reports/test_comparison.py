"""The comparison has every run, with its differences to the first."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pidtsm_core.errors import UsageError
from pidtsm_core.parameters.files import Settings
from pidtsm_core.recording import Recording
from pidtsm_studies.article.claims import Run
from pidtsm_studies.reports.comparison import check_comparable, differing_parameters, write_comparison
from pidtsm_studies.reports.labels import difference_text, run_entries, value_text
from pidtsm_studies.reports.plots import QUANTITIES, plot


def test_it_has_all_sections_with_the_differences(comparison: Path, compared: dict[str, Run]) -> None:
    page = comparison.read_text(encoding="utf-8")
    assert re.findall(r'<h2 id="(\w+)"', page) == ["parameters", "metrics", "plots", "arm"]
    assert re.findall(r'class="plot" id="case1-(\w+)"', page) == [quantity.name for quantity in QUANTITIES]
    assert '<th scope="row">controller.law.k1</th><td>1.0</td><td>3.0</td>' in page
    (_, gentle), (_, firm) = compared.values()
    for key in ("rmse", "eci", "torque_variation"):
        for a, b in zip(gentle[key], firm[key], strict=True):
            cells = f"<td>{value_text(a)}</td><td>{value_text(b)} <small>{difference_text(a, b)}</small></td>"
            assert cells in page


def test_the_same_runs_give_the_same_file(tmp_path: Path, comparison: Path, compared: dict[str, Run]) -> None:
    write_comparison(tmp_path / "again.html", compared, {"controller.law.k1": {"gentle": 1.0, "a/firm.1": 3.0}})
    assert (tmp_path / "again.html").read_bytes() == comparison.read_bytes()


@pytest.mark.parametrize(
    ("first", "value", "text"),
    [
        (2.0, 3.0, "+50.0 %"),
        (2.0, 1.0, "-50.0 %"),
        (-2.0, -3.0, "+50.0 %"),
        (2.0, 2.0, "same"),
        (0.0, 0.0, "same"),
        (0.0, 1.0, ""),
        (None, 1.0, ""),
        (1.0, None, ""),
    ],
)
def test_a_difference_is_relative_to_the_first_run(first: float | None, value: float | None, text: str) -> None:
    assert difference_text(first, value) == text


def lines(runs: Mapping[str, Run]) -> list[tuple[str, str | None]]:
    """Name and run of each line of the first joint."""
    figure = plot(QUANTITIES[0], runs, run_entries(runs))
    return [(trace.name, trace.meta) for trace in figure.data if trace.yaxis == "y"]


def shorter(recording: Recording) -> Recording:
    arrays = ("time", "stamps_ns", "position", "velocity", "effort", "reference", "signals", "status")
    return replace(recording, **{name: getattr(recording, name)[:500] for name in arrays})


def test_runs_share_a_reference_unless_theirs_differ(compared: dict[str, Run]) -> None:
    (recording, metrics), other = compared.values()
    runs: dict[str, Run] = {"a": (shorter(recording), metrics), "b": other}
    assert lines(runs) == [("reference", None), ("a", "a"), ("b", "b")]
    moved = replace(recording, reference=recording.reference + 0.1)
    runs["a"] = moved, metrics
    references = [("reference of a", "a"), ("reference of b", "b")]
    assert lines(runs) == [*references, ("a", "a"), ("b", "b")]


def test_many_runs_all_look_different(compared: dict[str, Run]) -> None:
    run = next(iter(compared.values()))
    runs = {f"run {n}": run for n in range(20)}
    figure = plot(QUANTITIES[1], runs, run_entries(runs))
    looks = [(trace.line.color, trace.line.dash) for trace in figure.data if trace.yaxis == "y"]
    assert len(set(looks)) == len(runs)


@pytest.mark.parametrize("change", [{"joints": ("joint2", "joint1")}, {"slides": (False, True)}])
def test_runs_of_other_joints_are_refused(compared: dict[str, Run], change: dict[str, Any]) -> None:
    recording, _ = compared["gentle"]
    check_comparable({"a": recording, "b": shorter(recording)})
    with pytest.raises(UsageError, match=r"b has other joints than a: joint. \(rad\), "):
        check_comparable({"a": recording, "b": replace(recording, **change)})


def test_parameters_differ_by_value_or_where_one_is_missing() -> None:
    run: Settings = {
        "controller": {"law.k1": [3.0, 2.0], "law.k2": 1, "autostart": True, "state.decimation": 1},
        "simulator": {"rate": 1000, "clock": "lockstep"},
    }
    rollout: Settings = {
        "controller": {"law.k1": [3.0, 4.0], "law.k2": 1.0, "law.layer": 0.1},
        "simulator": {"rate": 1000},
    }
    assert differing_parameters({"run": run, "rollout": rollout, "bag": {}}) == {
        "controller.law.k1": {"run": [3.0, 2.0], "rollout": [3.0, 4.0]},
        "controller.law.layer": {"rollout": 0.1},
    }
    realtime = {**run, "simulator": {"rate": 1000, "clock": "realtime"}}
    assert differing_parameters({"a": run, "b": realtime}) == {"simulator.clock": {"a": "lockstep", "b": "realtime"}}
    assert differing_parameters({"a": run, "b": {}}) == {}
