"""The pages of runs in a browser: play, cursor, chosen joint, overlaid runs, folds, keyboard and width."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from support.devtools import CHROMIUM, Page
from support.reportpage import DOWN, LEFT, SPACE, STATE, arm, at_the_end, in_si, lines, plotted, read, seen

from pidtsm_core.recording import Recording
from pidtsm_studies.reports.labels import CASES
from pidtsm_studies.reports.skeleton import find_skeleton

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium installed (apt-get install chromium)")


@pytest.fixture
def opened(page: Page, report: Path) -> Page:
    page.open(report)
    return page


def test_a_browser_draws_it_without_complaint_or_network(opened: Page, report: Path) -> None:
    assert plotted(opened, "error", "series.length") == 1 + 3, "three laws, one joint"
    assert opened.complaints == []
    assert [url for url in opened.requests if not url.startswith(("data:", "blob:"))] == [report.as_uri()]


def test_curves_are_folded_until_they_are_opened(opened: Page) -> None:
    assert opened.evaluate("document.getElementById('plot-sliding').plot ?? null") is None
    opened.click("summary:has(#curves)")
    opened.wait("Boolean(document.getElementById('plot-sliding').plot)")
    assert lines(opened, "position") == ["piddtsm 0", "pidnftsm 0", "dtsm 0"]
    opened.click("summary:has(#curves)")
    assert not opened.evaluate("document.getElementById('plot-sliding').checkVisibility()")


def test_the_first_screen_answers_what_a_reader_asks(page: Page, arms: dict[str, Path]) -> None:
    for robot in ("two_link", "panda"):
        page.open(arms[robot], 1280, 800)
        script = """[...document.querySelectorAll('.verdict, .answers div, #arm, #plot-error, #plot-effort')]
            .map((each) => each.getBoundingClientRect().top)"""
        tops = page.evaluate(script)
        assert len(tops) == 1 + 4 + 3
        assert max(tops) < 600
        assert page.evaluate("document.getElementById('play').getBoundingClientRect().bottom") <= 800


def test_the_first_screen_of_a_comparison_has_its_curves(page: Page, comparison: Path) -> None:
    page.open(comparison, 1280, 800)
    for part in (".answers", "#arm", "#plot-error", "#plot-effort", "#play"):
        assert page.evaluate(f"document.querySelector('{part}').getBoundingClientRect().bottom") <= 800
    line = page.evaluate("document.querySelector('#apart').parentElement.innerText")
    assert re.search(r"RMSE of joint\d [−+]\d", line)
    assert page.evaluate("document.querySelector('#apart').parentElement.clientHeight") < 60, "a line or two"


@pytest.mark.parametrize("width", [1280, 360])
def test_marks_have_words_that_do_not_cover_each_other(page: Page, arms: dict[str, Path], width: int) -> None:
    page.open(arms["panda"], width)
    boxes = page.evaluate(
        """[...document.querySelectorAll('#marks button')].map((each) => [each.innerText.replace('\\n', ' '),
            ...(({left, top, right, bottom}) => [left, top, right, bottom])(each.getBoundingClientRect())])"""
    )
    assert len(boxes) > 1
    if width > 1000:
        assert any("push 5\u202fN m" in text for text, *_ in boxes)
    for i, (text, left, top, right, bottom) in enumerate(boxes):
        assert left >= 0
        assert right <= width, text
        for other, left_2, top_2, right_2, bottom_2 in boxes[:i]:
            apart = left >= right_2 or left_2 >= right or top >= bottom_2 - 1 or top_2 >= bottom - 1
            assert apart, f"{text} covers {other}"


def test_a_joint_is_chosen_by_its_button_its_column_or_its_line(page: Page, arms: dict[str, Path]) -> None:
    page.open(arms["panda"])
    pressed = "[...document.querySelectorAll('#joints [aria-pressed=\"true\"]')].map((each) => each.textContent.trim())"
    assert page.evaluate(pressed) == ["all joints"]
    page.click('#joints [data-joint="3"]')
    assert page.evaluate(pressed) == ["panda_joint4"]
    faded = page.evaluate("document.getElementById('plot-effort').lines.map((each) => each.faded)")
    assert faded == [joint != 3 for joint in range(7)]
    assert len(arm(page, "chosen-0")) == 2, "it is marked on the arm"
    page.click('.matrix thead [data-joint="1"]')
    assert page.evaluate(pressed) == ["panda_joint2"]
    page.click('#joints [data-joint=""]')
    place = """(() => {
        document.getElementById('viewer').scrollIntoView();
        const box = document.getElementById('plot-effort'), { plot, lines } = box;
        const index = Math.round(plot.data[0].length / 2), over = plot.over.getBoundingClientRect();
        const [x, y] = [plot.valToPos(plot.data[0][index], 'x'), plot.valToPos(lines[3].values[index], 'y')];
        return [over.left + x, over.top + y];
    })()"""
    x, y = page.evaluate(place)
    for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
        page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
    page.wait(f"{STATE}.joint === 3")


def test_the_pointer_moves_the_cursor_of_every_plot_and_the_arm(page: Page, arms: dict[str, Path]) -> None:
    page.open(arms["two_link"])
    start = arm(page)
    x, y, width = page.evaluate(
        "(({left, top, width, height}) => [left, top + height / 2, width])"
        "(document.getElementById('plot-error').plot.over.getBoundingClientRect())"
    )
    page.call("Input.dispatchMouseEvent", type="mouseMoved", x=x + 0.75 * width, y=y)
    page.wait(f"Math.abs({STATE}.time - 1.5) < 0.02")
    assert np.abs(arm(page) - start).max() > 1.0
    places = "[...document.querySelectorAll('.first-curves .now')].map((each) => each.style.transform)"
    assert len(set(page.evaluate(places))) == 1
    assert page.evaluate("document.getElementById('clock').value") == f"{page.evaluate(f'{STATE}.time'):.2f} s"


def test_runs_are_overlaid_and_can_be_hidden(page: Page, comparison: Path) -> None:
    page.open(comparison)
    assert [each.partition(" ")[0] for each in lines(page)] == ["gentle", "a/firm.1"]
    assert len(arm(page, "links-0")) == len(arm(page, "links-1")) == 6, "two arms"
    page.focus("#time")
    page.key("PageUp", 33)
    assert np.abs(arm(page, "links-0") - arm(page, "links-1")).max() > 1.0
    page.click('input[name="run"][value="a/firm.1"]')
    assert [each.partition(" ")[0] for each in lines(page)] == ["gentle"]
    assert arm(page, "links-1").size == 0
    page.click('input[name="run"][value="a/firm.1"]')
    assert len(lines(page)) == 2
    page.click('#joints [data-joint=""]')
    assert len(lines(page)) == 4
    assert page.complaints == []


def test_all_time_axes_are_zoomed_together(opened: Page) -> None:
    ranges = """['error', 'effort'].map((name) => document.getElementById('plot-' + name).plot.scales.x)
        .map((x) => [x.min, x.max])"""
    whole = opened.evaluate(ranges)
    opened.drag("#plot-error .u-over", 150, 1)
    opened.wait(f"{ranges}[0][0] > 0.5")
    first, second = opened.evaluate(ranges)
    assert first == second
    assert 0.9 < first[0] < 1.1
    opened.click("#zoom-all")
    assert opened.evaluate(ranges) == whole
    opened.click("#zoom-in")
    (begin, end), _ = opened.evaluate(ranges)
    assert end - begin == pytest.approx(0.5 * (whole[0][1] - whole[0][0]))
    opened.click("#zoom-out")
    assert opened.evaluate(ranges) == whole


def test_the_error_is_shown_on_both_scales(opened: Page) -> None:
    opened.click('input[data-log="error"]')
    assert plotted(opened, "error", "scales.y.distr") == 3
    assert plotted(opened, "error", "data.slice(1).flat().every((y) => y === null || y > 0)")
    opened.click('input[data-log="error"]')
    assert plotted(opened, "error", "scales.y.distr") in (None, 1)
    assert plotted(opened, "error", "data.slice(1).flat().some((y) => y < 0)")


VIEWS = {"two_link": (-90.0, 0.0), "panda": (-60.0, 20.0), "scara": (-60.0, 20.0)}
"""Azimuth and elevation of the first view, degrees."""


@pytest.mark.parametrize("robot", VIEWS)
def test_every_arm_is_drawn_where_it_was_and_can_be_turned(
    page: Page, arms: dict[str, Path], recordings: dict[str, Recording], robot: str
) -> None:
    recording, (azimuth, elevation) = recordings[robot], VIEWS[robot]
    page.open(arms[robot])
    start = arm(page)
    sample = at_the_end(page, recording)
    skeleton = find_skeleton(recording.robot)
    reached, reference = (skeleton.points(q[sample : sample + 1])[0] for q in (recording.position, recording.desired))

    def check() -> None:
        for part, points in (("links-0", reached), ("reference-0", reference)):
            bones = np.stack([np.vstack([np.zeros((1, 3)), points[:-1]]), points], axis=1).reshape(-1, 3)
            found = arm(page, part)
            np.testing.assert_allclose(found, seen(page, bones, azimuth, elevation), atol=0.03)
            box = page.evaluate("document.getElementById('arm').getAttribute('viewBox')")
            left, top, width, height = map(float, box.split())
            assert np.all((found > (left, top)) & (found < (left + width, top + height))), "all of it is in view"
        assert len(arm(page, "sliding-0")) == 2 * sum(recording.slides)

    check()
    assert np.abs(arm(page) - start).max() > 1.0
    page.focus("#arm")
    for key, code in (("ArrowLeft", LEFT), ("ArrowDown", DOWN), ("ArrowDown", DOWN)):
        page.key(key, code)
    azimuth, elevation = azimuth + 5.0, elevation + 10.0
    check()
    page.drag("#arm", 40, -25)
    height = page.evaluate("document.getElementById('arm').clientHeight")
    azimuth, elevation = azimuth - 40.0 / height * 180.0, elevation - 25.0 / height * 180.0
    check()
    for joint in range(len(recording.joints)):
        for what, values in ((1, recording.error), (2, recording.effort)):
            assert in_si(read(page, joint, what)) == pytest.approx(values[sample, joint], rel=1e-2, abs=1e-11)
    distance = float(np.linalg.norm(reached[-1] - reference[-1]))
    text = page.evaluate("document.getElementById('readout').caption.textContent")
    assert in_si(re.search(r"the tool is (.*) from", text)[1]) == pytest.approx(distance, rel=1e-2)  # type: ignore[index]
    assert page.complaints == []


def test_efforts_are_arcs_that_grow_with_them(
    page: Page, arms: dict[str, Path], recordings: dict[str, Recording]
) -> None:
    recording = recordings["panda"]
    page.open(arms["panda"])
    sample = at_the_end(page, recording)
    angles = page.evaluate(
        f"""(() => {{
            const run = Object.values(data.viewer.runs)[0], count = data.viewer.joints.length;
            const efforts = unpack(run.effort), row = Math.round({STATE}.time * data.viewer.rate);
            return Array.from({{length: count}}, (_, j) => efforts[row * count + j] / run.largest[j]);
        }})()"""
    )
    limits = (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)
    np.testing.assert_allclose(angles, recording.effort[sample] / limits, rtol=1e-3, atol=1e-6)
    path = page.evaluate("document.getElementById('arm-arcs-0').getAttribute('d')")
    assert path.count("M") == 7, "an arc for each joint"


def test_the_keys_that_turn_the_arm_do_not_scroll_the_page(opened: Page) -> None:
    opened.evaluate("document.getElementById('viewer').scrollIntoView()")
    before = opened.evaluate("scrollY")
    opened.focus("#arm")
    opened.key("ArrowDown", DOWN)
    opened.evaluate("new Promise(requestAnimationFrame)")
    assert opened.evaluate("[scrollY, data.viewer.arm.view[1]]") == [before, pytest.approx(math.pi / 36)]
    for _ in range(20):
        opened.key("ArrowDown", DOWN)
    assert opened.evaluate("data.viewer.arm.view[1]") == pytest.approx(0.5 * math.pi)  # from above, not upside down


def test_play_and_pause_work_from_the_keyboard(opened: Page) -> None:
    opened.focus("#play")
    opened.key(" ", SPACE, " ")
    opened.wait(f"{STATE}.time > 0.2")
    assert opened.evaluate("document.getElementById('play').textContent") == "Pause"
    opened.key(" ", SPACE, " ")
    assert opened.evaluate("document.getElementById('play').textContent") == "Play"
    paused = arm(opened)
    opened.evaluate("new Promise(resolve => setTimeout(resolve, 200))")
    np.testing.assert_array_equal(arm(opened), paused)
    opened.evaluate("document.getElementById('speed').value = '10'")
    opened.key(" ", SPACE, " ")
    opened.wait("document.getElementById('play').textContent === 'Play'")  # it stops at the end
    assert opened.evaluate(f"{STATE}.time") == pytest.approx(
        opened.evaluate("Number(document.getElementById('time').max)")
    )


def test_case_and_marks_of_the_time_line(opened: Page) -> None:
    opened.focus("#time")
    opened.key("PageUp", 33)
    first = arm(opened)
    kinds = "[...document.querySelectorAll('#marks button')].map((each) => each.className)"
    assert "payload" not in opened.evaluate(kinds)
    opened.focus("#case")
    opened.key("ArrowDown", DOWN)
    opened.wait("document.getElementById('case').value === 'case2'")
    assert "payload" in opened.evaluate(kinds)
    opened.focus("#marks .payload")
    opened.key("Enter", 13, "\r")
    assert opened.evaluate(f"{STATE}.time") == pytest.approx(1.0)
    assert "the load of the arm changes" in opened.evaluate("document.getElementById('event').textContent")
    assert np.abs(arm(opened) - first).max() > 0.0


@pytest.mark.parametrize("width", [1280, 1024, 360])
def test_the_page_is_as_wide_as_the_window(page: Page, report: Path, arms: dict[str, Path], width: int) -> None:
    page.open(arms["panda"], width)
    assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    page.open(report, width)
    page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
    page.wait("Boolean(document.getElementById('plot-sliding').plot)")
    assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    widest = page.evaluate("Math.max(...[...document.querySelectorAll('.uplot')].map((each) => each.clientWidth))")
    assert 0.5 * width < widest <= width


def test_a_page_that_is_printed_has_nothing_folded(opened: Page) -> None:
    closed = "document.querySelectorAll('details:not([open])').length"
    before = opened.evaluate(closed)
    opened.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert (before > 0, opened.evaluate(closed)) == (True, 0)
    assert opened.evaluate("Boolean(document.getElementById('plot-sliding').plot)")
    opened.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert opened.evaluate(closed) == before


def test_every_case_has_its_curves(opened: Page) -> None:
    for case in CASES:
        opened.evaluate(f"document.getElementById('case').value = '{case}'")
        opened.evaluate("document.getElementById('case').dispatchEvent(new Event('change'))")
        assert len(lines(opened)) == 3
