"""The report: what is in the file, and what a browser makes of it."""

import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from devtools import CHROMIUM, Page, browser

from pidtsm_core.recording import Recording
from pidtsm_core.rollout import rollout
from pidtsm_core.signals import Fault, Mode, Signal, Status, Violation
from pidtsm_core.summary import summarize
from pidtsm_studies.article.claims import Run, compare
from pidtsm_studies.reports.labels import CASES
from pidtsm_studies.reports.report import LINKS, write_report

DURATION = 2.0  # s
LAWS = {"piddtsm": 3.0, "pidnftsm": 2.0, "dtsm": 1.0}  # gains of stand-ins
PLOTS = ("tracking", "error", "torque", "sliding", "manifold", "gain")
NOTE = "DTSM with the printed kappa ends at 0.5 s <not a tag> & so on."
FAILED = "the loop is not finite any more after 0.5 s"


def run(case: str, law: str, gain: float = 3.0) -> Run:
    result = rollout({"controller": {"law.k1": gain}}, DURATION)
    recording = Recording.of_rollout(result, case, law, 1.0 if case == "case2" else None)
    return recording, summarize(recording)


@pytest.fixture(scope="module")
def reproduction() -> dict[tuple[str, str], Run | str]:
    runs: dict[tuple[str, str], Run | str] = {
        (case, law): run(case, law, gain) for case in CASES for law, gain in LAWS.items()
    }
    return {**runs, ("case1", "dtsm_printed"): FAILED}


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory, reproduction: dict[tuple[str, str], Run | str]) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(path, reproduction, compare(reproduction), [NOTE])
    return path


@pytest.fixture(scope="module")
def single(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("single") / "report.html"
    write_report(path, run("case1", "piddtsm"))
    return path


class Outline(HTMLParser):
    """Tags with their attributes, and text outside scripts and styles."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.data: dict[str, Any] = {}
        self._inside = ""
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._inside = "data" if dict(attrs).get("id") == "data" else tag

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside == "data":
            self.data = json.loads(data)
        elif self._inside not in ("script", "style"):
            self.text += data

    def ids(self, tag: str) -> list[str]:
        return [attributes["id"] or "" for name, attributes in self.tags if name == tag and "id" in attributes]


def test_it_has_all_sections_and_plots(report: Path) -> None:
    outline = Outline(report)
    assert outline.ids("h2") == ["arm", "article", "metrics", "plots", "deviations"]
    assert [i for i in outline.ids("div") if "-" in i and i.partition("-")[0] in CASES] == list(outline.data["figures"])
    assert list(outline.data["figures"]) == [f"{case}-{plot}" for case in CASES for plot in PLOTS]
    assert sorted(outline.data["arm"]["runs"]) == sorted(f"{case} {law}" for case in CASES for law in LAWS)
    assert NOTE in outline.text
    assert FAILED in outline.text


def test_every_row_is_in_its_table_with_its_reason(
    report: Path, reproduction: dict[tuple[str, str], Run | str]
) -> None:
    text = Outline(report).text
    links = {attributes.get("href") for tag, attributes in Outline(report).tags if tag == "a"}
    for row in compare(reproduction):
        for part in (row.what, row.article, row.project, row.where, row.why):
            assert part in text
    assert {f"#{i}" for i in Outline(report).ids("li")} <= links


def test_it_asks_for_nothing_outside(report: Path) -> None:
    for tag, attributes in Outline(report).tags:
        assert tag not in ("iframe", "object", "embed", "img")
        assert "src" not in attributes
        assert str(attributes.get("href", "#")).startswith(("#", "data:"))
    assert "default-src 'none'" in report.read_text(encoding="utf-8")


def test_links_and_labels_lead_somewhere(report: Path) -> None:
    outline = Outline(report)
    ids = [attributes["id"] for _, attributes in outline.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    for _, attributes in outline.tags:
        for key in ("aria-labelledby", "for"):
            assert key not in attributes or attributes[key] in ids
        href = attributes.get("href") or ""
        assert not href.startswith("#") or href[1:] in ids


def test_tables_have_a_caption_and_heads(report: Path) -> None:
    tags = [tag for tag, _ in Outline(report).tags]
    assert tags.count("table") == tags.count("caption") == 4
    assert all("scope" in attributes for tag, attributes in Outline(report).tags if tag == "th")


def test_the_same_runs_give_the_same_file(
    tmp_path: Path, report: Path, reproduction: dict[tuple[str, str], Run | str]
) -> None:
    write_report(tmp_path / "again.html", reproduction, compare(reproduction), [NOTE])
    assert (tmp_path / "again.html").read_bytes() == report.read_bytes()


def test_a_long_reproduction_stays_small(tmp_path: Path) -> None:
    recording, metrics = run("case1", "piddtsm")
    random = np.random.default_rng(0)
    samples = 30_000
    noise = Recording(
        **{
            **vars(recording),
            "time": np.arange(samples) / 1000,
            "position": random.normal(size=(samples, 2)),
            "effort": random.normal(size=(samples, 2)),
            "reference": random.normal(size=(samples, 3, 2)),
            "signals": random.normal(size=(samples, len(Signal), 2)),
            "status": np.zeros((samples, len(Status)), dtype=np.uint8),
        }
    )
    runs = {(case, f"law{n}"): (noise, metrics) for case in CASES for n in range(6)}
    write_report(tmp_path / "report.html", runs)
    assert (tmp_path / "report.html").stat().st_size < 12e6


def test_a_single_run_has_no_comparison(single: Path) -> None:
    outline = Outline(single)
    assert outline.ids("h2") == ["arm", "metrics", "plots"]
    assert "Case 1, PIDDTSM" in outline.text
    assert ("input", "law") not in [(tag, attributes.get("name")) for tag, attributes in outline.tags]


def happened(path: Path) -> str:
    """What the section says, as HTML."""
    return path.read_text(encoding="utf-8").partition('<h2 id="happened">')[2].partition("</section>")[0]


def test_what_is_not_normal_stands_first(tmp_path: Path) -> None:
    recording, _ = run("case1", "piddtsm")
    status = recording.status.copy()
    status[500:700] = (Mode.STOPPED, Fault.VELOCITY_LIMIT, 1, Violation.VELOCITY)
    odd = replace(recording, joints=("<b>", "joint2"), status=status, rejected={"controller": 2})
    write_report(tmp_path / "report.html", (odd, summarize(odd)))
    assert Outline(tmp_path / "report.html").ids("h2") == ["happened", "arm", "metrics", "plots"]
    told = happened(tmp_path / "report.html")
    assert "stopped at 0.5 s: &lt;b&gt; is beyond limits.velocity; reset at 0.7 s" in told
    assert "messages rejected: controller 2" in told


def test_runs_of_which_something_is_told_are_named(tmp_path: Path) -> None:
    bad, good = run("case1", "dtsm"), run("case1", "piddtsm")
    lost = replace(bad[0], position=bad[0].position + 4.0)
    write_report(tmp_path / "report.html", {("case1", "dtsm"): (lost, summarize(lost)), ("case1", "piddtsm"): good})
    told = happened(tmp_path / "report.html")
    assert told.count("<ul>") == 1
    assert "Case 1, DTSM:" in told


def test_a_run_that_ran_away_has_no_errors_to_compare(tmp_path: Path) -> None:
    recording, _ = run("case1", "piddtsm")
    lost = replace(recording, position=recording.position + 4.0)
    write_report(tmp_path / "report.html", (lost, summarize(lost)))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("<td>ran away</td>") == 3 * 2
    assert f"{summarize(lost)['rmse'][0]:.5g}" not in Outline(tmp_path / "report.html").text


def test_a_run_that_says_nothing_of_itself_is_reported(tmp_path: Path) -> None:
    recording, _ = run("case1", "piddtsm")
    nameless = replace(recording, scenario=None, law=None, clock=None)
    write_report(tmp_path / "report.html", (nameless, summarize(nameless)))
    assert "unknown law" in Outline(tmp_path / "report.html").text


def test_an_arm_with_other_joints_than_links_is_not_drawn(tmp_path: Path) -> None:
    write_report(tmp_path / "report.html", run("case1", "piddtsm"), links=(1.0, 1.0, 1.0))
    assert "arm" not in Outline(tmp_path / "report.html").ids("h2")


def test_names_cannot_break_the_page(tmp_path: Path) -> None:
    recording, _ = run("case1", "piddtsm")
    odd = replace(recording, scenario="</script><b>", law='a"><script>alert(1)</script>', joints=("<i>", "&amp;"))
    write_report(tmp_path / "report.html", (odd, summarize(odd)))
    plain = Outline(tmp_path / "report.html")
    assert not {"b", "i"} & {tag for tag, _ in plain.tags}
    assert [tag for tag, _ in plain.tags].count("script") == 3
    assert "<i>" in plain.text


# In a browser.

needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no chromium installed (apt-get install chromium)")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(tmp_path_factory.mktemp("browser") / "profile") as page:
        yield page


@pytest.fixture
def opened(page: Page, report: Path) -> Page:
    page.open(report)
    return page


def show_all_plots(page: Page) -> None:
    """Scroll through the page as a reader does."""
    for number in range(page.evaluate("document.querySelectorAll('.plot').length")):
        plot = f"document.querySelectorAll('.plot')[{number}]"
        page.evaluate(f"{plot}.scrollIntoView()")
        page.wait(f"{plot}.querySelectorAll('.scatterlayer .trace').length > 0")


def traces(page: Page, law: str) -> int:
    """How many lines of a law are drawn, in all plots."""
    return int(
        page.evaluate(
            "[...document.querySelectorAll('.plot')].flatMap(plot => plot._fullData || [])"
            f".filter(trace => trace.meta === {law!r} && trace.visible === true).length"
        )
    )


def lines(page: Page, plot: str) -> int:
    return int(page.evaluate(f"document.querySelectorAll('#{plot} .scatterlayer .trace .js-line').length"))


def arm(page: Page, part: str = "links") -> list[tuple[float, float]]:
    points = page.evaluate(f"document.getElementById('arm-{part}').getAttribute('points')")
    return [(float(x), float(y)) for x, y in (point.split(",") for point in points.split())]


@needs_chromium
def test_a_browser_draws_everything_without_complaint_or_network(opened: Page, report: Path) -> None:
    show_all_plots(opened)
    assert opened.evaluate("document.querySelectorAll('.plot .main-svg').length") >= len(CASES) * len(PLOTS)
    assert traces(opened, "piddtsm") == len(CASES) * len(PLOTS) * 2
    assert opened.complaints == []
    assert [url for url in opened.requests if not url.startswith(("data:", "blob:"))] == [report.as_uri()]
    buttons = opened.evaluate("[...document.querySelectorAll('.modebar-btn')].map(button => button.dataset.title)")
    assert "Reset axes" in buttons
    assert not any("hare" in title or "loud" in title for title in buttons)


@needs_chromium
def test_a_box_takes_its_law_out_of_every_plot(opened: Page) -> None:
    opened.evaluate("document.getElementById('case1-tracking').scrollIntoView()")
    opened.wait("document.querySelectorAll('#case1-tracking .scatterlayer .trace').length > 0")
    before = lines(opened, "case1-tracking")
    opened.click('input[name="law"][value="dtsm"]')
    assert traces(opened, "dtsm") == 0
    show_all_plots(opened)  # also in those that had not been drawn
    assert traces(opened, "dtsm") == 0
    assert traces(opened, "piddtsm") == len(CASES) * len(PLOTS) * 2
    assert lines(opened, "case1-tracking") == before - 2
    opened.click('input[name="law"][value="dtsm"]')
    assert traces(opened, "dtsm") == len(CASES) * len(PLOTS) * 2


@needs_chromium
def test_the_legend_and_the_boxes_say_the_same(opened: Page) -> None:
    show_all_plots(opened)
    toggles = "document.querySelectorAll('#case2-torque .legendtoggle')"
    assert opened.evaluate(f"{toggles}.length") == len(LAWS)
    opened.evaluate(f"{toggles}[1].setAttribute('data-test', 'pidnftsm')")
    opened.click('[data-test="pidnftsm"]')
    opened.wait("!document.querySelector('input[value=\"pidnftsm\"]').checked")  # after its wait for a double click
    assert traces(opened, "pidnftsm") == 0
    assert traces(opened, "dtsm") > 0


@needs_chromium
def test_the_error_is_shown_on_both_scales(opened: Page) -> None:
    opened.click('input[data-log="case1-error"]')
    layout = "document.getElementById('case1-error')._fullLayout"
    opened.wait(f"{layout}?.yaxis2.type === 'log'")
    smallest = "Math.min(...document.getElementById('case1-error')._fullData.flatMap(t => [...t.y]))"
    assert opened.evaluate(smallest) >= 0.0
    opened.click('input[data-log="case1-error"]')
    opened.wait(f"{layout}.yaxis2.type === 'linear'")
    assert opened.evaluate(smallest) < 0.0


@needs_chromium
def test_the_slider_moves_the_arm_to_where_it_was(opened: Page, reproduction: dict[tuple[str, str], Run | str]) -> None:
    recording = reproduction["case1", "piddtsm"][0]
    assert isinstance(recording, Recording)
    start = arm(opened)
    opened.focus("#arm-time")
    opened.key("End", 35)
    opened.wait(f"Number(document.getElementById('arm-time').value) > {DURATION - 0.1}")
    for part, angles in (("links", recording.position), ("reference", recording.reference[:, 0])):
        sample = round(opened.evaluate("Number(document.getElementById('arm-time').value)") * 1000)
        sums = np.cumsum(angles[sample])
        tip = [np.dot(LINKS, np.cos(sums)), -np.dot(LINKS, np.sin(sums))]
        np.testing.assert_allclose(arm(opened, part)[-1], tip, atol=2e-5)
    assert arm(opened) != start
    shown = opened.evaluate("document.getElementById('arm-error-0').value")
    assert float(shown.removesuffix(" rad")) == pytest.approx(recording.error[sample, 0], rel=1e-2)
    assert opened.evaluate("document.getElementById('arm-clock').value").startswith(f"{sample / 1000:.2f}")
    opened.key("Home", 36)
    opened.wait("document.getElementById('arm-time').value === '0'")
    assert arm(opened) == start


@needs_chromium
def test_play_and_pause_work_from_the_keyboard(opened: Page) -> None:
    opened.focus("#arm-play")
    opened.key(" ", 32, " ")
    opened.wait("Number(document.getElementById('arm-time').value) > 0.2")
    assert opened.evaluate("document.getElementById('arm-play').textContent") == "Pause"
    opened.key(" ", 32, " ")
    assert opened.evaluate("document.getElementById('arm-play').textContent") == "Play"
    paused = arm(opened)
    opened.evaluate("new Promise(resolve => setTimeout(resolve, 200))")
    assert arm(opened) == paused
    opened.evaluate("document.getElementById('arm-speed').value = '10'")
    opened.key(" ", 32, " ")
    opened.wait("document.getElementById('arm-play').textContent === 'Play'")  # it stops at the end
    slider = "document.getElementById('arm-time')"
    assert opened.evaluate(f"{slider}.value === {slider}.max")


@needs_chromium
def test_case_and_law_of_the_arm_are_chosen(opened: Page) -> None:
    opened.focus("#arm-time")
    opened.key("PageUp", 33)
    first = arm(opened)
    assert not opened.evaluate("document.getElementById('arm-event').checkVisibility()")
    opened.focus("#arm-law")
    opened.key("ArrowDown", 40)
    opened.wait("document.getElementById('arm-law').value === 'pidnftsm'")
    assert arm(opened) != first
    opened.focus("#arm-case")
    opened.key("ArrowDown", 40)
    opened.wait("document.getElementById('arm-event').checkVisibility()")
    assert "1 s" in opened.evaluate("document.getElementById('arm-event').textContent")


@needs_chromium
@pytest.mark.parametrize("width", [1200, 400])
def test_the_page_is_as_wide_as_the_window(page: Page, report: Path, width: int) -> None:
    page.open(report, width)
    show_all_plots(page)
    assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    widest = page.evaluate("Math.max(...[...document.querySelectorAll('.plot svg')].map(s => s.clientWidth))")
    assert 0.8 * width < widest <= width


@needs_chromium
def test_a_single_run_works_alone(page: Page, single: Path) -> None:
    page.open(single)
    show_all_plots(page)
    assert traces(page, "piddtsm") == len(PLOTS) * 2
    toggles = "document.querySelector('#case1-error .legendtoggle')"
    page.evaluate(f"{toggles}.setAttribute('data-test', 'own')")
    page.click('[data-test="own"]')
    page.wait("document.querySelectorAll('#case1-error .scatterlayer .js-line').length === 0")
    assert page.complaints == []
    assert math.isclose(math.hypot(*arm(page)[1]), LINKS[0], abs_tol=1e-4)


@needs_chromium
def test_text_is_dark_on_light(opened: Page) -> None:
    script = """[...document.querySelectorAll('h1, h2, p, th, td, caption, small, label, a, dt, dd')]
        .map(element => getComputedStyle(element).color)"""
    for colour in set(opened.evaluate(script)):
        red, green, blue = (int(part) / 255 for part in re.findall(r"\d+", colour)[:3])
        luminance = sum(
            weight * (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4)
            for weight, part in ((0.2126, red), (0.7152, green), (0.0722, blue))
        )
        assert 1.05 / (luminance + 0.05) >= 4.5, colour
