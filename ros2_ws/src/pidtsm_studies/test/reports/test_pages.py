"""What holds for every page: its numbers are those of metrics.json, anyone can use it, and it is small."""

import json
import re
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.devtools import CHROMIUM, Page

from pidtsm_core.recording import Recording
from pidtsm_core.recording.metric import METRICS
from pidtsm_core.recording.outcome import OF_TRACKING, RAN_AWAY
from pidtsm_core.recording.summary import write_metrics
from pidtsm_core.written import number, quantity
from pidtsm_studies.reports.comparison import write_comparison

in_browser = pytest.mark.skipif(CHROMIUM is None, reason="no chromium installed (apt-get install chromium)")
NOTATION = re.compile(r"\d[eE][-+]?\d|\d-\d{2}\b(?!-)")
"""Powers of ten as computers write them."""


class Cells(HTMLParser):
    """The cells of matrices that name a metric and a joint: value for programs, and text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.cells: list[tuple[str, int, str, str]] = []
        self.text = ""
        self._cell: dict[str, Any] = {}
        self._data: str | None = None
        self._skip = False
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self._skip = tag in ("script", "style")
        if tag == "td":
            self._cell = values if "data-key" in values else {}
        if tag == "data":
            self._data = values["value"]

    def handle_endtag(self, tag: str) -> None:
        self._skip = False
        self._data = None if tag == "data" else self._data

    def handle_data(self, data: str) -> None:
        if self._data is not None and self._cell:
            self.cells.append((self._cell["data-key"], int(self._cell["data-joint"]), self._data, data))
        if not self._skip:
            self.text += data


@pytest.mark.parametrize("robot", ["two_link", "panda", "scara"])
def test_no_number_differs_from_metrics_json(
    robot: str, arms: dict[str, Path], recordings: dict[str, Recording], tmp_path: Path
) -> None:
    write_metrics(recordings[robot].metrics(), tmp_path / "metrics.json")
    metrics = json.loads((tmp_path / "metrics.json").read_text(encoding="utf-8"))
    factors = {metric.key: metric.factor for metric in METRICS}
    cells = Cells(arms[robot]).cells
    misleading = OF_TRACKING if metrics["outcome"] == RAN_AWAY else ()
    meaningful = [key for key in factors if key in metrics and key not in misleading]
    known = {(key, joint) for key in meaningful for joint, value in enumerate(metrics[key]) if value is not None}
    assert {(key, joint) for key, joint, _, _ in cells} == known
    for key, joint, value, text in cells:
        assert float(value) == metrics[key][joint]
        shown = [number(factor * metrics[key][joint]) for factor in (1.0, 1e2, 1e3, 1e6, 1e9)]
        assert text in [*shown, str(metrics[key][joint])]


def test_no_page_has_numbers_in_computer_notation(arms: dict[str, Path], report: Path, comparison: Path) -> None:
    for page in (*arms.values(), report, comparison):
        assert not NOTATION.findall(re.sub(r"[0-9a-f]{40}", "the commit", Cells(page).text))


def test_the_worst_joint_is_marked_not_by_colour_alone(arms: dict[str, Path], recordings: dict[str, Recording]) -> None:
    page = arms["panda"].read_text(encoding="utf-8")
    marked = re.findall(r'<td class="is-worst" data-key="(\w+)" data-joint="(\d)">', page)
    assert page.count('<span class="hidden"> worst</span>') == len(marked) > 3
    rmse = recordings["panda"].metrics()["rmse"]
    assert ("rmse", str(int(np.argmax(rmse)))) in marked


@in_browser
def test_scripts_write_numbers_as_python_does(page: Page, arms: dict[str, Path]) -> None:
    page.open(arms["two_link"])
    random = np.random.default_rng(0)
    values = [*(random.normal(size=400) * 10.0 ** random.integers(-12, 9, 400)), 0.0, 1.125, 0.5, 1e-3, 999.5, 1e6, 1e4]
    texts = page.evaluate(f"{json.dumps(values)}.map((x) => [written(x), written(x, 2), quantity(x, 'rad')])")
    assert texts == [[number(x), number(x, 2), quantity(x, "rad")] for x in values]


@in_browser
@pytest.mark.parametrize("name", ["panda", "report", "comparison"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(page: Page, pages: dict[str, Path], name: str, scheme: str) -> None:
    axe = (files("axe_core_python") / "axe.min.js").read_text(encoding="utf-8")
    page.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    try:
        page.open(pages[name])
        page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
        page.evaluate(axe)
        found = page.evaluate("axe.run().then((result) => result.violations)")
    finally:
        page.call("Emulation.setEmulatedMedia", features=[])
    assert [(each["id"], each["impact"], [node["html"][:200] for node in each["nodes"]][:3]) for each in found] == []


@pytest.fixture(scope="module")
def pages(arms: dict[str, Path], report: Path, comparison: Path) -> dict[str, Path]:
    return {"panda": arms["panda"], "report": report, "comparison": comparison}


def lengthened(recording: Recording, duration: float) -> Recording:
    """The same motion again and again, with noise, so that nothing compresses."""
    times = int(duration / (recording.time[-1] + 1e-3)) + 1
    arrays = ("position", "velocity", "effort", "reference", "signals", "status")
    values: dict[str, Any] = {
        name: np.concatenate([getattr(recording, name)] * times)[: int(1000 * duration)] for name in arrays
    }
    samples = len(values["position"])
    values["stamps_ns"] = np.arange(samples) * 1_000_000
    values["time"] = values["stamps_ns"] / 1e9
    return Recording(**{**vars(recording), **values})


def test_eight_runs_of_seven_joints_and_thirty_seconds_stay_small(
    tmp_path: Path, recordings: dict[str, Recording]
) -> None:
    recording = lengthened(recordings["panda"], 30.0)
    metrics = recording.metrics()
    sizes = []
    for count in (2, 8):
        write_comparison(tmp_path / "page.html", {f"run {n}": (recording, metrics) for n in range(count)}, {})
        sizes.append((tmp_path / "page.html").stat().st_size)
    assert sizes[0] < 3e6
    assert sizes[1] < 5e6


def test_code_of_others_has_its_licence_beside_it_and_in_the_page(arms: dict[str, Path]) -> None:
    folder = files("pidtsm_studies.reports") / "templates" / "uplot"
    licence = (folder / "LICENSE").read_text(encoding="utf-8")
    assert "MIT" in licence
    assert licence.strip() in arms["two_link"].read_text(encoding="utf-8")
