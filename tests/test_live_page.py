"""The live page in a real browser: it shows the arm, its controls reach the nodes, and what is refused has a reason.

What else the page does is tested without a browser, whose software renderer takes most of a machine.
"""

import re
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from numpy.typing import NDArray
from support.devtools import CHROMIUM, browser
from support.judges import opened
from support.livepage import LivePage, live_process, parameter

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium installed (apt-get install chromium)")

_SETTLED = 2.0
"""Error of an arm that nothing disturbs, mrad."""


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LivePage]:
    folder = tmp_path_factory.mktemp("live")
    # Not this machine's usual address, so the browser also has to find its way by the token.
    with live_process(folder, "--host", "127.0.0.2") as system, browser(folder / "profile", in_3d=True) as page:
        shown = LivePage(page, system)
        shown.until(lambda: "Following" in shown.text("#status"), "the arm follows")
        yield shown


def test_the_arm_moves(live: LivePage, tmp_path: Path) -> None:
    def picture(name: str) -> NDArray[np.float32]:
        live.page.screenshot(tmp_path / name, x=450, y=150, width=150, height=350)
        return np.asarray(imread(tmp_path / name)[:, :, :3])

    pictures = []

    def drawn() -> bool:
        pictures.append(picture("first.png"))
        return len(np.unique((pictures[-1].reshape(-1, 3) * 255).astype(int), axis=0)) > 20

    live.until(drawn, "the arm")
    first = pictures[-1]

    def moved() -> bool:
        return bool(np.any(np.abs(picture("later.png") - first) > 0.2, axis=2).sum() > 100)

    live.until(moved, "another picture of the arm")
    # Nobody looks at the arm in what follows.
    live.page.evaluate("document.querySelector('canvas').parentElement.style.display = 'none'")


def test_one_joint_is_chosen_for_all_curves(live: LivePage) -> None:
    chart = """Object.values(window.__viserTestpoints.uplots).map((plot) => plot.chart)
        .find((chart) => chart.root.textContent.includes('error e'))"""
    shown = f"{chart}.series.slice(1).filter((line) => line.show !== false).map((line) => line.label)"
    assert live.page.evaluate(shown) == ["joint1", "joint2", "events"]
    live.choose("joint shown", "joint2")
    live.until(lambda: live.page.evaluate(shown) == ["joint2", "events"], "the curves of joint2 alone")
    live.choose("time window", "5 s")
    live.until(lambda: live.page.evaluate(f"{chart}.scales.x.min") == -5.0, "the last 5 s")
    live.choose("joint shown", "all joints")
    live.choose("time window", "20 s")
    live.until(lambda: live.page.evaluate(shown) == ["joint1", "joint2", "events"], "the curves of all joints")


def test_a_gain_changed_on_the_page_is_the_nodes_a_bad_one_is_refused_and_it_is_undone(live: LivePage) -> None:
    live.press("Controller")
    before = parameter(live.system, "law.k1")
    live.enter("k1", "3.5, 2.5")
    live.until(lambda: live.notification() == "set law.k1 = 3.5, 2.5", "the gain is set")
    assert parameter(live.system, "law.k1") == (3.5, 2.5)
    live.enter("k1", "-1")
    live.until(lambda: "law.k1: -1 must be >= 0" in live.notification().replace("law.k1 (", "law.k1: ("), "the reason")
    assert parameter(live.system, "law.k1") == (3.5, 2.5)
    live.until(lambda: "law.k1" in live.text("#changes"), "the change is listed")
    height = "document.querySelector('#changes').offsetHeight"
    listed = live.page.evaluate(height)
    live.press("Undo")
    live.until(lambda: parameter(live.system, "law.k1") == before, "the gain of before")
    live.until(lambda: not live.text("#changes"), "the list is empty")
    assert live.page.evaluate(height) == listed > 0, "what is below the list has moved"


def test_a_slider_sets_the_stiffness_and_a_box_shows_the_gizmo(live: LivePage) -> None:
    live.press("Controller")
    live.step("stiffness [N/m]")
    live.until(lambda: parameter(live.system, "compliance.stiffness")[:3] == (1010.0,) * 3, "the stiffness is set")
    live.press("Undo")
    live.press("Motion")
    live.flip("drag the tool", on=True)
    live.until(lambda: "the gizmo drags the tool" in live.text("#events"), "the gizmo is there")
    live.flip("drag the tool", on=False)


def test_freedrive_and_hold_are_switches_that_show_what_the_controller_does(live: LivePage) -> None:
    live.press("Controller")
    live.flip("freedrive", on=True)
    live.until(lambda: "Freedrive: the arm can be moved by hand" in live.text("#status"), "freedrive")
    live.flip("freedrive", on=False)
    live.until(lambda: "Holding its position on request" in live.text("#status"), "the arm is held")
    live.until(lambda: live.checked("hold") and not live.checked("freedrive"), "both switches show it")
    live.flip("hold", on=False)
    live.until(lambda: "Following" in live.text("#status"), "the arm follows")


def test_a_recording_shows_its_size_until_it_is_ended(live: LivePage) -> None:
    live.press("Keep")
    live.press("Record")
    sizes = r"recording, \d+ samples, (\d+\.\d) MB so far"
    live.until(lambda: (found := re.search(sizes, live.text("#bag"))) and float(found[1]) > 0.2, "some of a megabyte")
    live.press("End the recording")
    live.until(lambda: " MB recorded: " in live.text("#bag"), "its end")
    bag = Path(live.text("#bag").partition("recorded: ")[2].strip())
    with opened(bag) as (reader, _):
        assert reader.message_count > 200


@pytest.mark.parametrize("action", ["Push", "Pick up"])
def test_a_push_and_a_load_show_in_the_curves(live: LivePage, action: str) -> None:
    live.press("Disturb")
    live.until(lambda: live.worst_error(1.0) < _SETTLED, "the arm follows closely")
    pressed = time.monotonic()
    live.press(action)
    live.until(lambda: live.worst_error(time.monotonic() - pressed) > 2.0 * _SETTLED, "the error")
    live.until(lambda: live.spikes() and action.lower().split()[0] in live.text("#marks"), "its mark on the curves")
    live.press("Drop")


def test_killing_the_controller_is_shown_and_starting_it_recovers(live: LivePage) -> None:
    live.press("Disturb")
    live.press("Kill the controller")
    live.until(lambda: "was killed by signal 9" in live.text("#status"), "the end of the controller")
    live.press("Controller")
    live.press("Activate")
    live.until(lambda: "Following" in live.text("#status"), "the arm follows again")
