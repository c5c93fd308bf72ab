"""The page and the document have every controller, the best first, and scores that differ in extent are refused."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from support.devtools import CHROMIUM, Page

from pidtsm_core.errors import UsageError
from pidtsm_studies.score.criteria import CRITERIA, FULL
from pidtsm_studies.score.leaderboard import read_entries, write_leaderboard
from pidtsm_studies.score.results import Entry, as_json
from pidtsm_studies.score.wording import cells

RANGES = sum(len(criterion.ranges) for criterion in CRITERIA)


@pytest.fixture(scope="module")
def entries(entry: Entry) -> list[Entry]:
    """The same controller without one of its successes, and on another arm."""
    first = entry.outcomes[0]
    curve = replace(first.curves[0], successes=(0, *first.curves[0].successes[1:]))
    worse = replace(first, curves=(curve, *first.curves[1:]))
    other = replace(entry, law="pid", name="pid", outcomes=(worse, *entry.outcomes[1:]))
    lost = replace(entry, task=replace(entry.task, robot="panda"), nominal={"ideal": None, "hardware": None})
    return [other, entry, lost]


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory, entries: list[Entry]) -> Path:
    folder = tmp_path_factory.mktemp("leaderboard")
    write_leaderboard(folder, entries)
    return folder


def test_the_document_has_a_row_for_each_controller_the_best_first(board: Path, entries: list[Entry]) -> None:
    text = (board / "leaderboard.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == ["panda", "two_link"]
    rows = [line for line in text.splitlines() if line.startswith(("| PID ", "| mine "))]
    assert rows == [f"| {' | '.join(cells(entries[i]))} |" for i in (2, 1, 0)]
    for image in re.findall(r"\]\((images/.*)\)", text):
        assert (board / image).stat().st_size > 10_000


def test_the_page_has_every_range_of_every_arm_and_loads_nothing_from_outside(board: Path) -> None:
    page = (board / "leaderboard.html").read_text(encoding="utf-8")
    assert re.findall(r'<h2 id="(\w+)"', page) == ["filters", "overview", "panda", "two_link", "method"]
    assert len(re.findall(r'class="plot" data-chart="', page)) == 2 * RANGES
    assert "default-src 'none'" in page


def test_scores_are_read_from_a_folder_and_must_have_one_extent(entry: Entry, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no score\.json below this folder"):
        read_entries(tmp_path)
    for name, each in {"a": entry, "b": replace(entry, name="other")}.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "score.json").write_text(json.dumps(as_json(each)))
    assert [each.name for each in read_entries(tmp_path)] == ["mine", "other"]
    (tmp_path / "b" / "score.json").write_text(json.dumps(as_json(entry)))
    with pytest.raises(UsageError, match=r"are both mine on two_link; remove one"):
        read_entries(tmp_path)
    (tmp_path / "b" / "score.json").write_text(json.dumps(as_json(replace(entry, extent=FULL))))
    with pytest.raises(UsageError, match="a quick score cannot be compared"):
        read_entries(tmp_path)


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium installed (apt-get install chromium)")
def test_a_browser_draws_the_curves(page: Page, board: Path) -> None:
    page.open(board / "leaderboard.html")
    rows = "[...document.querySelectorAll('tr[data-tags]')].filter((row) => row.checkVisibility()).length"
    drawn = "[...document.querySelectorAll('[data-chart]')].filter((box) => box.plot).length"
    assert page.evaluate(rows) == 2 + 6, "the overview, and two tables for each entry"
    assert page.evaluate(drawn) == RANGES, "those of other arms are folded"
    page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
    page.wait(f"{drawn} === {2 * RANGES}")
    shown = "document.getElementById('two_link-noise-1').plot.series.filter((line) => line.show).length - 1"
    assert page.evaluate(shown) == 2
    page.click('input[data-filter="law"][value="pid"]')
    assert page.evaluate(rows) == 1 + 4
    assert page.evaluate(shown) == 1
    overview = (
        "[...document.querySelectorAll('.overview tr')].map((row) => row.innerText.replace(/[\\t\\n]+/g, ' ').trim())"
    )
    score = page.evaluate("document.querySelector('.overview data').innerText")
    assert page.evaluate(overview)[0] == "controller panda two_link"
    assert score in page.evaluate(overview)[1]
    page.click('input[data-filter="arm"][value="panda"]')
    assert page.evaluate(overview)[0] == "controller two_link"
    assert page.evaluate(rows) == 1 + 2
    assert page.evaluate("document.getElementById('filtered').textContent") == "3 of 8 rows shown"
    assert page.evaluate("document.querySelector('[data-hardware=\"ideal\"]').hidden") is False
    page.focus("[data-filter='hardware']")
    page.key("ArrowDown", 40)
    page.wait("document.querySelector('span[data-hardware=\"ideal\"]').hidden")
    assert page.complaints == []
