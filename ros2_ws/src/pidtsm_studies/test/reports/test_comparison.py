"""The comparison has every run, with its differences to the first."""

import base64
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pidtsm_core.arrays import Array
from pidtsm_core.errors import UsageError
from pidtsm_core.parameters.files import Settings
from pidtsm_core.recording import Recording
from pidtsm_core.units import SLIDES, JointUnits
from pidtsm_core.written import Scale
from pidtsm_studies.article.claims import Run
from pidtsm_studies.reports.animation import animation
from pidtsm_studies.reports.comparison import check_comparable, differing_parameters, write_comparison
from pidtsm_studies.reports.curves import Quantity, curves
from pidtsm_studies.reports.labels import difference_text
from pidtsm_studies.reports.matrix import difference
from pidtsm_studies.reports.styles import looks


def test_what_differs_comes_first(comparison: Path, compared: dict[str, Run]) -> None:
    page = comparison.read_text(encoding="utf-8")
    assert re.findall(r'<h2 id="([-\w]+)"', page) == [
        "apart",
        "motion",
        "differs",
        "metrics",
        "more-metrics",
        "happened",
        "curves",
        "made",
    ]
    assert '<th scope="row">controller.law.k1</th><td>1.0</td><td>3.0</td>' in page
    (_, gentle), (_, firm) = compared.values()
    for key in ("rmse", "eci", "torque_variation"):
        for a, b in zip(gentle[key], firm[key], strict=True):
            assert f'<data value="{b!r}"' in page
            assert f"<small>{difference(a, b, Scale('', 1.0))}</small>" in page
    verdict_text = page.partition('class="verdict')[2].partition("</p>")[0]
    assert "a/firm.1 follows more closely" in verdict_text


def test_equal_runs_are_reported_as_equal(tmp_path: Path, compared: dict[str, Run]) -> None:
    run = compared["gentle"]
    write_comparison(tmp_path / "report.html", {"a": run, "b": run}, {})
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "The runs are equal in every metric of every joint." in page
    assert page.count("Equal for every joint of every run: largest error, RMSE, steady-state error") == 1
    assert "Where the metrics differ most" not in page


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


@pytest.mark.parametrize(
    ("first", "value", "text"),
    [
        (2.0, 3.0, "+50 %"),
        (2.0, 1.0, "−50 %"),
        (2.0, 2.0, "="),
        (0.0, 0.0, "="),
        (0.0, 1.0, "+1"),
        (0.1, 5.0, "50 ×"),
        (5.0, 0.1, "50 × smaller"),
        (None, 1.0, ""),
        (1.0, None, ""),
    ],
)
def test_a_difference_on_a_page_is_short(first: float | None, value: float | None, text: str) -> None:
    assert difference(first, value, Scale("", 1.0)).replace("\u202f", " ") == text


def shorter(recording: Recording) -> Recording:
    arrays = ("time", "stamps_ns", "position", "velocity", "effort", "reference", "signals", "status")
    return replace(recording, **{name: getattr(recording, name)[:500] for name in arrays})


def test_runs_share_a_reference_unless_theirs_differ(compared: dict[str, Run]) -> None:
    run = compared["gentle"]
    moved = replace(run[0], reference=run[0].reference + 0.1)

    def references(other: Recording) -> list[str]:
        found = animation({"case": {"a": run, "b": (other, run[1])}})["runs"]
        assert [bool(each["reference"]) for each in found.values()] == [
            each["reference_of"] == key for key, each in found.items()
        ]
        return [each["reference_of"] for each in found.values()]

    assert references(run[0]) == ["case a", "case a"]
    assert references(moved) == ["case a", "case b"]


def test_many_runs_all_look_different() -> None:
    assert len({str(looks(style)) for style in range(40)}) == 40


def test_no_spike_is_lost_by_decimation() -> None:
    samples, time = np.zeros((30_000, 7)), np.arange(30_000) / 1e3
    random = np.random.default_rng(0)
    spikes = random.integers(0, 30_000, 7), np.arange(7)
    samples[spikes] = random.normal(size=7)
    quantity = Quantity("spikes", "Spikes", "x", "m", lambda _: samples)
    drawn = curves({"run": Samples(time, tuple("abcdefg"), (SLIDES,) * 7)}, [quantity])
    values = np.frombuffer(base64.b64decode(drawn["values"]["run"]["spikes"]), "<f4").reshape(7, -1)
    times = np.frombuffer(base64.b64decode(drawn["time"]), "<f4")
    assert values.shape[1] == times.size <= 2000
    assert np.all(np.diff(times) > 0.0)
    np.testing.assert_allclose(values.sum(axis=1), samples[spikes], rtol=1e-6)
    near = times[np.abs(values).argmax(axis=1)]
    np.testing.assert_allclose(near, time[spikes[0]], atol=30.0 / 1000)


@dataclass(frozen=True)
class Samples:
    time: Array
    joints: tuple[str, ...]
    units: tuple[JointUnits, ...]


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
