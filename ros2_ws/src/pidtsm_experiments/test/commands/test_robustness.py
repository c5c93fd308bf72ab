"""The robustness command: its numbers are those of rollouts, failures count as such, and all of it is left behind."""

import json
import math
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from devtools import CHROMIUM, browser

from pidtsm_core.batch import BatchResult, Settings
from pidtsm_core.experiment import PRACTICAL, make_experiment
from pidtsm_core.metrics import metrics
from pidtsm_core.parameters import Array
from pidtsm_core.rollout import Rollout, rollout
from pidtsm_core.signals import Signal
from pidtsm_experiments.cli import main
from pidtsm_studies.robustness import study as module
from pidtsm_studies.robustness.study import (
    CONTENDERS,
    FULL,
    IMPERFECTIONS,
    METRICS,
    OBSERVER,
    QUICK,
    ROW_CONTENDERS,
    ROWS,
    Imperfection,
    Robustness,
    Row,
    as_json,
    measure,
    measured_text,
    tolerance,
)

NAMES = [contender.name for contender in CONTENDERS]
DEADLINE = 120.0


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("robustness") / "out"


@pytest.fixture(scope="module")
def said(out: Path) -> dict[str, Any]:
    command = [sys.executable, "-m", "pidtsm_experiments.cli", "robustness", "--quick", "--json", "--out", str(out)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def judged(result: Rollout) -> dict[str, Array]:
    error = result.position - result.reference[:, 0]
    found = metrics(result.time, error, result.effort, result.signals[:, Signal.SATURATED])
    late = np.abs(error[result.time >= 10.0]).max(axis=0)
    return {**{name: np.array(values, dtype=float) for name, values in found.items()}, "late_error": late}


def roll(scenario: str, *overrides: str) -> dict[str, Array]:
    experiment = make_experiment(scenario, params=[PRACTICAL], overrides=overrides)
    return judged(rollout(experiment.settings, QUICK.duration))


def test_everything_is_left_behind(out: Path, said: dict[str, Any]) -> None:
    assert json.loads((out / "robustness.json").read_text()) == said
    figures = {f"{imperfection.name}.{kind}" for imperfection in IMPERFECTIONS for kind in ("png", "svg")}
    assert {file.name for file in (out / "figures").iterdir()} == figures
    assert {entry.name for entry in out.iterdir()} == {"robustness.json", "figures", "report.html"}


def test_every_controller_meets_every_imperfection(said: dict[str, Any]) -> None:
    assert list(said["imperfections"]) == [imperfection.name for imperfection in IMPERFECTIONS]
    for imperfection in said["imperfections"].values():
        assert list(imperfection["contenders"]) == NAMES
        for curve in imperfection["contenders"].values():
            assert set(curve["metrics"]) == set(METRICS)
            assert np.shape(curve["metrics"]["rmse"]) == (3, QUICK.values, 2)
    assert [list(row["contenders"]) for row in said["rows"]] == [[c.name for c in ROW_CONTENDERS]] * len(ROWS)


def test_a_curve_has_the_percentiles_of_its_rollouts(said: dict[str, Any]) -> None:
    noise = said["imperfections"]["noise"]
    found = [roll("case1", f"simulator.noise.std={noise['values'][-1]}", f"simulator.seed={seed}") for seed in (0, 1)]
    for name, (low, middle, high) in noise["contenders"][OBSERVER.name]["metrics"].items():
        values = np.sort([each[name] for each in found], axis=0)
        np.testing.assert_array_equal([low[-1], middle[-1], high[-1]], [values[0], values[0], values[1]])


def test_a_row_has_the_worst_of_its_rollouts(said: dict[str, Any]) -> None:
    ideal = roll("case1")
    found = [roll(scenario, *overrides) for scenario, overrides in ROWS[-1].runs]
    assert len(found) == 2
    values = said["rows"][-1]["contenders"][OBSERVER.name]["values"]
    for name in ("rmse", "eci"):
        assert values[name] == max((each[name] / ideal[name]).max() for each in found)
    for name in ("late_error", "torque_variation"):
        assert values[name] == max(each[name].max() for each in found)


def test_success_has_an_interval_only_where_something_is_random(said: dict[str, Any]) -> None:
    for imperfection in IMPERFECTIONS:
        for curve in said["imperfections"][imperfection.name]["contenders"].values():
            low, high = curve["interval"]
            if not imperfection.random:
                assert low == high == [None, None]
                continue
            for below, rate, above in zip(low, curve["success"], high, strict=True):
                assert below <= rate <= above
                assert 0.5 < above - below < 1.0  # two runs tell little


@pytest.mark.parametrize("imperfection", IMPERFECTIONS, ids=lambda imperfection: imperfection.name)
def test_an_imperfection_says_whether_it_is_random(imperfection: Imperfection) -> None:
    settings = OBSERVER.settings("case1")
    settings["simulator"].update(imperfection.settings(imperfection.values[10]))
    assert differs_by_seed(settings) == imperfection.random


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.runs[0][0])
def test_a_row_says_whether_it_is_random(row: Row) -> None:
    for scenario, overrides in row.runs:
        assert differs_by_seed(OBSERVER.settings(scenario, overrides)) == row.random


def differs_by_seed(settings: Settings) -> bool:
    seeded = ({**settings, "simulator": {**settings["simulator"], "seed": seed}} for seed in (0, 1))
    first, second = (rollout(each, 3.0).effort.tobytes() for each in seeded)
    return first != second


@pytest.fixture
def with_failures(monkeypatch: pytest.MonkeyPatch) -> Robustness:
    """All runs are good but some of the first contender's with ever coarser encoders, which are the first runs."""

    def batch(settings: Iterable[Settings], *_: object, **__: object) -> BatchResult:
        runs = len(list(settings))
        good = {"rmse": 0.04, "eci": 30.0, "torque_variation": 0.01, "late_error": 0.0199, "late_saturation": 0.0}
        table = {name: np.full((runs, 2), value) for name, value in good.items()}
        for values in table.values():
            values[3] = np.nan
        table["late_error"][4, 1] = 0.02
        table["late_saturation"][5, 0] = 1e-4
        return BatchResult(table, {3: "the loop is not finite any more after 1 s"}, [])

    monkeypatch.setattr(module, "batch", batch)
    return measure(FULL, lambda done, total: None)


def test_divergence_large_errors_and_torque_at_its_limit_are_failures(with_failures: Robustness) -> None:
    encoder, dropout = (next(i for i in IMPERFECTIONS if i.name == name) for name in ("encoder", "dropout"))
    curve = with_failures.curves["encoder"][OBSERVER.name]
    np.testing.assert_array_equal(np.flatnonzero(curve.success < 1.0), [3, 4, 5])
    assert tolerance(with_failures, encoder, OBSERVER.name) == f"{encoder.values[2]:g}"
    assert tolerance(with_failures, dropout, OBSERVER.name) == "all"
    assert with_failures.diverged == 1


def test_what_diverged_has_no_numbers(with_failures: Robustness) -> None:
    curve = as_json(with_failures)["imperfections"]["encoder"]["contenders"][OBSERVER.name]
    for table in curve["metrics"].values():
        assert np.array(table)[:, 3].tolist() == [[None, None]] * 3
        assert None not in np.array(table)[:, [2, 4]]
    assert measured_text(math.inf) == "diverged"


def test_a_row_is_met_when_all_its_limits_are_kept(with_failures: Robustness) -> None:
    judged = with_failures.rows[0][OBSERVER.name]
    assert judged.met(ROWS[0]) == {"rmse": True, "eci": True, "late_error": False, "torque_variation": True}
    assert with_failures.met() == 0


def test_a_full_call_has_twenty_values_and_seeds_within_its_budget(with_failures: Robustness) -> None:
    assert (FULL.values, FULL.seeds) == (20, 20)
    assert all(len(values) == 20 == len(set(values)) for values in with_failures.values.values())
    assert with_failures.runs <= 60_000


def test_the_report_shows_all_and_asks_for_nothing_outside(out: Path, said: dict[str, Any]) -> None:
    page = (out / "report.html").read_text(encoding="utf-8")
    assert re.findall(r'<h2 id="(\w+)"', page) == ["rows", "tolerance", "curves", "method"]
    assert re.findall(r'class="plot" id="(\w+)"', page) == list(said["imperfections"])
    assert re.findall(r'name="law" value="(\w+)"', page) == NAMES
    assert "default-src 'none'" in page
    for row in ROWS:
        assert row.label in page


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium installed (apt-get install chromium)")
def test_a_browser_draws_every_curve(tmp_path: Path, out: Path, said: dict[str, Any]) -> None:
    with browser(tmp_path / "profile") as page:
        page.open(out / "report.html")
        for name in said["imperfections"]:
            page.evaluate(f"document.getElementById('{name}').scrollIntoView()")
            page.wait(f"document.querySelectorAll('#{name} .scatterlayer .trace .js-line').length > 0")
        page.click('input[name="law"][value="dtsm"]')
        shown = "document.getElementById('noise')._fullData.filter(t => t.meta === '{}' && t.visible === true).length"
        assert page.evaluate(shown.format("dtsm")) == 0
        assert page.evaluate(shown.format("pid")) == 8  # a band and a line in each panel
        assert page.complaints == []


def test_the_tables_on_the_terminal_name_all(
    with_failures: Robustness, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    for name in ("write_robustness_figures", "write_robustness_report"):
        monkeypatch.setattr(f"pidtsm_experiments.commands.robustness.{name}", lambda *_: None)
    assert main(["robustness", "--out", str(tmp_path / "out")]) == 0
    text = capfd.readouterr().out
    for word in (*(row.label for row in ROWS), *(i.name for i in IMPERFECTIONS), "✗", "0 of 6 rows"):
        assert word in text


def test_an_interrupt_ends_it_cleanly(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pidtsm_experiments.cli", "robustness", "--out", "mine"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + DEADLINE
    while not (tmp_path / "mine.unfinished").exists():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=DEADLINE)
    assert process.returncode == 130
    assert out == ""
    assert err.splitlines()[-1] == "pidtsm: interrupted"
    assert "Traceback" not in err
    assert not (tmp_path / "mine").exists()
