"""The report in a browser: plots, boxes, animation, keyboard and width."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from support.devtools import CHROMIUM, Page

from pidtsm_core.arrays import Array
from pidtsm_core.recording import Recording
from pidtsm_studies.reports.labels import CASES
from pidtsm_studies.reports.skeleton import find_skeleton

PLOTS = 6  # a case
LAWS = 3

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium installed (apt-get install chromium)")


@pytest.fixture
def opened(page: Page, report: Path) -> Page:
    page.open(report)
    return page


def show_all_plots(page: Page) -> None:
    """Scroll through the page like a reader."""
    for index in range(page.evaluate("document.querySelectorAll('.plot').length")):
        plot = f"document.querySelectorAll('.plot')[{index}]"
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


def arm(page: Page, part: str = "links") -> Array:
    """Points of a part of the drawing, shape (points, 2)."""
    path = page.evaluate(f"document.getElementById('arm-{part}').getAttribute('d')")
    return np.array(re.findall(r"[-\d.]+", path), dtype=np.float64).reshape(-1, 2)


def seen(page: Page, points: Array, azimuth: float, elevation: float) -> Array:
    """Where the page must draw points, shape (points, 3), that are seen from a direction (degrees)."""
    centre, radius = page.evaluate("[data.arm.centre, data.arm.radius]")
    a, e = math.radians(azimuth), math.radians(elevation)
    right = -math.sin(a), math.cos(a), 0.0
    up = -math.cos(a) * math.sin(e), -math.sin(a) * math.sin(e), math.cos(e)
    return (points - centre) / radius @ np.array([right, up]).T * [1.0, -1.0]


def at_the_end(page: Page, recording: Recording) -> int:
    """Move the slider to the end; returns the sample of the run."""
    page.focus("#arm-time")
    page.key("End", 35)
    page.wait(f"Number(document.getElementById('arm-time').value) > {recording.time[-1] - 0.1}")
    return round(page.evaluate("Number(document.getElementById('arm-time').value)") * 1000)


def test_a_browser_draws_everything_without_complaint_or_network(opened: Page, report: Path) -> None:
    show_all_plots(opened)
    assert opened.evaluate("document.querySelectorAll('.plot .main-svg').length") >= len(CASES) * PLOTS
    assert traces(opened, "piddtsm") == len(CASES) * PLOTS * 2
    assert opened.complaints == []
    assert [url for url in opened.requests if not url.startswith(("data:", "blob:"))] == [report.as_uri()]
    buttons = opened.evaluate("[...document.querySelectorAll('.modebar-btn')].map(button => button.dataset.title)")
    assert "Reset axes" in buttons
    assert not any("hare" in title or "loud" in title for title in buttons)


def test_a_box_hides_its_law_in_every_plot(opened: Page) -> None:
    opened.evaluate("document.getElementById('case1-tracking').scrollIntoView()")
    opened.wait("document.querySelectorAll('#case1-tracking .scatterlayer .trace').length > 0")
    before = lines(opened, "case1-tracking")
    opened.click('input[name="law"][value="dtsm"]')
    assert traces(opened, "dtsm") == 0
    show_all_plots(opened)  # also in those that had not been drawn
    assert traces(opened, "dtsm") == 0
    assert traces(opened, "piddtsm") == len(CASES) * PLOTS * 2
    assert lines(opened, "case1-tracking") == before - 2
    opened.click('input[name="law"][value="dtsm"]')
    assert traces(opened, "dtsm") == len(CASES) * PLOTS * 2


def test_the_legend_and_the_boxes_agree(opened: Page) -> None:
    show_all_plots(opened)
    toggles = "document.querySelectorAll('#case2-torque .legendtoggle')"
    assert opened.evaluate(f"{toggles}.length") == LAWS
    opened.evaluate(f"{toggles}[1].setAttribute('data-test', 'pidnftsm')")
    opened.click('[data-test="pidnftsm"]')
    opened.wait("!document.querySelector('input[value=\"pidnftsm\"]').checked")  # after its wait for a double click
    assert traces(opened, "pidnftsm") == 0
    assert traces(opened, "dtsm") > 0


def test_the_error_is_shown_on_both_scales(opened: Page) -> None:
    opened.click('input[data-log="case1-error"]')
    layout = "document.getElementById('case1-error')._fullLayout"
    opened.wait(f"{layout}?.yaxis2.type === 'log'")
    smallest = "Math.min(...document.getElementById('case1-error')._fullData.flatMap(t => [...t.y]))"
    assert opened.evaluate(smallest) >= 0.0
    names = "['yaxis', 'yaxis2'].map(axis => document.getElementById('case1-error')._fullLayout[axis].title.text)"
    assert opened.evaluate(names) == ["joint1<br>|e| (rad)", "joint2<br>|e| (rad)"]
    opened.click('input[data-log="case1-error"]')
    opened.wait(f"{layout}.yaxis2.type === 'linear'")
    assert opened.evaluate(smallest) < 0.0
    assert opened.evaluate(names) == [f"joint{j}<br>e = q − q<sub>d</sub> (rad)" for j in (1, 2)]


def test_compared_runs_are_toggled_and_zoomed(page: Page, comparison: Path) -> None:
    page.open(comparison)
    show_all_plots(page)
    assert traces(page, "gentle") == traces(page, "a/firm.1") == PLOTS * 2
    page.click('input[name="law"][value="a/firm.1"]')
    assert (traces(page, "gentle"), traces(page, "a/firm.1")) == (PLOTS * 2, 0)
    page.click('input[name="law"][value="a/firm.1"]')
    assert traces(page, "a/firm.1") == PLOTS * 2
    page.evaluate("document.getElementById('case1-error').scrollIntoView({block: 'center'})")
    ranges = "['xaxis', 'xaxis2'].map(axis => document.getElementById('case1-error')._fullLayout[axis].range)"
    assert page.evaluate(ranges)[0][0] < 0.1
    page.drag("#case1-error .nsewdrag", 150, 1)  # from the middle, along the time axis
    page.wait(f"{ranges}[0][0] > 0.5")
    (start, end), other = page.evaluate(ranges)
    assert 0.9 < start < 1.1
    assert 1.1 < end < 1.9
    assert other == [start, end], "the joints share the time axis"
    page.click('input[data-log="case1-error"]')
    page.wait("document.getElementById('case1-error')._fullLayout.yaxis.type === 'log'")
    assert page.evaluate(ranges)[0] == [start, end]
    assert page.complaints == []


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
        for part, points in (("links", reached), ("reference", reference)):
            bones = np.stack([np.vstack([np.zeros((1, 3)), points[:-1]]), points], axis=1).reshape(-1, 3)
            np.testing.assert_allclose(arm(page, part), seen(page, bones, azimuth, elevation), atol=3e-5)
        assert len(arm(page, "sliding")) == 2 * sum(recording.slides)

    check()
    assert np.abs(arm(page) - start).max() > 0.01
    page.focus("#arm-drawing")
    for key, code in (("ArrowLeft", 37), ("ArrowDown", 40), ("ArrowDown", 40)):
        page.key(key, code)
    azimuth, elevation = azimuth + 5.0, elevation + 10.0
    check()
    page.drag("#arm-drawing", 40, -25)
    height = page.evaluate("document.getElementById('arm-drawing').clientHeight")
    azimuth, elevation = azimuth - 40.0 / height * 180.0, elevation - 25.0 / height * 180.0
    check()
    for joint, unit in enumerate(recording.units):
        number, shown = page.evaluate(f"document.getElementById('arm-error-{joint}').value").split()
        assert shown == unit.position
        assert float(number) == pytest.approx(recording.error[sample, joint], rel=1e-2)
    distance = 1000.0 * np.linalg.norm(reached[-1] - reference[-1])
    text = page.evaluate("document.getElementById('arm-distance').value")
    assert float(text.removesuffix(" mm")) == pytest.approx(distance, rel=1e-2)
    assert page.complaints == []


def test_the_keys_that_turn_the_arm_do_not_scroll_the_page(opened: Page) -> None:
    opened.evaluate("document.getElementById('arm').scrollIntoView()")
    before = opened.evaluate("scrollY")
    opened.focus("#arm-drawing")
    opened.key("ArrowDown", 40)
    opened.evaluate("new Promise(requestAnimationFrame)")
    assert opened.evaluate("[scrollY, data.arm.view[1]]") == [before, pytest.approx(math.pi / 36)]
    for _ in range(20):
        opened.key("ArrowDown", 40)
    assert opened.evaluate("data.arm.view[1]") == pytest.approx(0.5 * math.pi)  # from above, not upside down


def test_the_slider_moves_the_arm_through_its_run(opened: Page, recordings: dict[str, Recording]) -> None:
    start = arm(opened)
    sample = at_the_end(opened, recordings["two_link"])
    assert opened.evaluate("document.getElementById('arm-clock').value").startswith(f"{sample / 1000:.2f}")
    assert np.abs(arm(opened) - start).max() > 0.01
    opened.key("Home", 36)
    opened.wait("document.getElementById('arm-time').value === '0'")
    np.testing.assert_array_equal(arm(opened), start)


def test_play_and_pause_work_from_the_keyboard(opened: Page) -> None:
    opened.focus("#arm-play")
    opened.key(" ", 32, " ")
    opened.wait("Number(document.getElementById('arm-time').value) > 0.2")
    assert opened.evaluate("document.getElementById('arm-play').textContent") == "Pause"
    opened.key(" ", 32, " ")
    assert opened.evaluate("document.getElementById('arm-play').textContent") == "Play"
    paused = arm(opened)
    opened.evaluate("new Promise(resolve => setTimeout(resolve, 200))")
    np.testing.assert_array_equal(arm(opened), paused)
    opened.evaluate("document.getElementById('arm-speed').value = '10'")
    opened.key(" ", 32, " ")
    opened.wait("document.getElementById('arm-play').textContent === 'Play'")  # it stops at the end
    slider = "document.getElementById('arm-time')"
    assert opened.evaluate(f"{slider}.value === {slider}.max")


def test_case_and_law_of_the_arm_are_chosen(opened: Page) -> None:
    opened.focus("#arm-time")
    opened.key("PageUp", 33)
    first = arm(opened)
    assert not opened.evaluate("document.getElementById('arm-event').checkVisibility()")
    opened.focus("#arm-law")
    opened.key("ArrowDown", 40)
    opened.wait("document.getElementById('arm-law').value === 'pidnftsm'")
    assert np.abs(arm(opened) - first).max() > 1e-3
    opened.focus("#arm-case")
    opened.key("ArrowDown", 40)
    opened.wait("document.getElementById('arm-event').checkVisibility()")
    assert "1 s" in opened.evaluate("document.getElementById('arm-event').textContent")


@pytest.mark.parametrize("width", [1200, 400])
def test_the_page_is_as_wide_as_the_window(page: Page, report: Path, width: int) -> None:
    page.open(report, width)
    show_all_plots(page)
    assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    widest = page.evaluate("Math.max(...[...document.querySelectorAll('.plot svg')].map(s => s.clientWidth))")
    assert 0.8 * width < widest <= width


def test_a_single_run_of_seven_joints_works_alone(page: Page, arms: dict[str, Path]) -> None:
    page.open(arms["panda"])
    show_all_plots(page)
    assert traces(page, "piddtsm") == PLOTS * 7
    toggles = "document.querySelector('#panda-error .legendtoggle')"
    page.evaluate(f"{toggles}.setAttribute('data-test', 'own')")
    page.click('[data-test="own"]')
    page.wait("document.querySelectorAll('#panda-error .scatterlayer .js-line').length === 0")
    assert page.complaints == []


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
