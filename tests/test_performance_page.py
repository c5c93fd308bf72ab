"""docs/performance.md is made of the figures of whole runs, and has every benchmark that takes at most ten minutes."""

import re
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

import performance  # noqa: E402

LONG = 600.0
"""s."""
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
    page = performance.page([RESULT])
    assert "x86_64, 2 cores, Python 3.12.1" in page
    assert "| controller step (a note) | 1.23e+03 ns | the call alone | 412 ns | 3 | <= 2, missed |" in page
    assert "## batch" in page


@pytest.mark.parametrize("partly", [{"quick": True}, {"complete": False}], ids=lambda p: next(iter(p)))
def test_figures_of_a_quick_or_interrupted_run_are_refused(partly: dict[str, bool]) -> None:
    with pytest.raises(ValueError, match="whole runs"):
        performance.page([RESULT, {**RESULT, **partly}])


def test_the_page_has_every_benchmark_that_does_not_take_long() -> None:
    texts = {file.stem: file.read_text("utf-8") for file in (ROOT / "benchmarks").glob("*.py")}
    takes = {name: re.search(r"^TAKES = ([\d.]+)", text, re.MULTILINE) for name, text in texts.items()}
    names = {name for name, seconds in takes.items() if seconds and float(seconds[1]) < LONG}
    assert set(re.findall(r"^## (\w+)$", performance.PAGE.read_text("utf-8"), re.MULTILINE)) >= names
