"""docs/performance.md is made of the figures of a whole run, and has every benchmark that a whole run has."""

import re
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

import performance  # noqa: E402

ROW = {
    "benchmark": "tick",
    "name": "controller step",
    "figure": 1234.5,
    "unit": "ns",
    "floor": "the call alone",
    "floor_figure": 411.5,
    "ratio": 3.0,
    "target": "<= 2",
    "note": "a note",
    "met": False,
}
RESULT: dict[str, Any] = {
    "machine": {"processor": "x86_64", "cores": 2, "load": 0.12, "python": "3.12.1"},
    "quick": False,
    "complete": True,
    "rows": [ROW, {**ROW, "benchmark": "batch", "floor": None, "target": None}],
}


def test_a_row_shows_figure_floor_ratio_and_a_missed_target() -> None:
    page = performance.page(RESULT)
    assert "x86_64, 2 cores, Python 3.12.1" in page
    assert "| controller step (a note) | 1.23e+03 ns | the call alone | 412 ns | 3 | <= 2, missed |" in page
    assert "## batch" in page


@pytest.mark.parametrize("partly", [{"quick": True}, {"complete": False}], ids=lambda p: next(iter(p)))
def test_figures_of_a_quick_or_interrupted_run_are_refused(partly: dict[str, bool]) -> None:
    with pytest.raises(ValueError, match="whole run"):
        performance.page({**RESULT, **partly})


def test_the_page_has_every_benchmark_of_a_whole_run() -> None:
    files = (ROOT / "benchmarks").glob("*.py")
    names = {file.stem for file in files if "\ndef run(" in file.read_text("utf-8")} - {"soak"}
    assert set(re.findall(r"^## (\w+)$", performance.PAGE.read_text("utf-8"), re.MULTILINE)) == names
