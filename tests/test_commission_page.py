"""The whole commissioning of a stranger's plant by clicks in a real browser."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from ament_index_python.packages import get_package_prefix
from support import heavyplant
from support.devtools import CHROMIUM, browser
from support.heavyplant import INVERTED, HeavyPlant, heavy_plant
from support.livepage import LivePage, LiveSystem, free_port, until
from support.testbed import open_testbed

from pidtsm_core.experiment import make_experiment
from pidtsm_experiments.commissioning.consent import QUESTION, heading
from pidtsm_experiments.commissioning.remote import is_held, release
from pidtsm_studies.commissioning.session import NAMES

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium installed (apt-get install chromium)")

URDF = Path(__file__).parents[1] / "ros2_ws/src/two_link_sim/urdf/two_link.urdf"
ARM = (f"robot.description:={URDF}", "limits.effort:=[120.0, 80.0]", "autostart:=false")
SLOW = 200
"""Hz; the plant waits for each answer, so that the session takes as long as its computing."""
CARRIED, SILENT = "brakes or a support must carry the arm", "no usable joint_states"
HELD = 0.25
"""rad; an arm that is held moves less, even if it is 20 % heavier than its model and its rate is low."""


class Scene(NamedTuple):
    """A page of a real arm, and the arm."""

    live: LivePage
    arm: HeavyPlant

    def opened(self) -> None:
        """Open the tab; nobody looks at the arm, which takes time to draw."""
        page = self.live.page
        page.wait("document.querySelector('[role=tab]') !== null")
        page.evaluate("document.querySelector('canvas').parentElement.style.display = 'none'")
        until(lambda: "REAL ARM" in self.live.text("#status"), "the page")
        self.live.press("Commission")

    def says(self, text: str) -> None:
        """Wait until the session says something."""
        until(lambda: text in self.live.text("#commission"), lambda: f"{text}, not {self.live.text('#commission')}")

    def click(self, label: str, within: str = "body") -> bool:
        """Click on a button, and return whether it is there.

        Not with the mouse, which misses what moves while lines appear above it.
        """
        buttons = f"[...document.querySelectorAll('{within} button')].filter(b => b.offsetParent !== null)"
        script = f"(b => (b?.click(), Boolean(b)))({buttons}.find(b => b.textContent.trim() === {json.dumps(label)}))"
        return bool(self.live.page.evaluate(script))

    def confirmed(self, label: str, question: str) -> None:
        """Press a button, and confirm it."""
        until(lambda: self.click(label), label)
        until(lambda: question in self.live.text("[role=dialog]"), question)
        until(lambda: self.click(label, "[role=dialog]"), label)
        until(lambda: not self.live.text("[role=dialog]"), "the end of the question")

    def stopped(self) -> None:
        """Press Stop until the session has stopped."""

        def pressed() -> bool:
            self.click("Stop")
            return "stopped" in self.live.text("#commission")

        until(pressed, lambda: f"stopped, not {self.live.text('#commission')}")

    def _waits(self, step: str) -> bool:
        text = self.live.text("#commission")
        return heading(step) in text and QUESTION in text

    def agreed(self, step: str) -> None:
        """Agree to a step, once it is asked for."""
        until(lambda: self._waits(step), lambda: f"{step}, not {self.live.text('#commission')}")
        self.confirmed("Agree", QUESTION)

    def all_agreed(self) -> list[str]:
        """Agree to every step, and return them; go on if one ends because the machine stood still for a second."""
        steps: list[str] = []

        def text() -> str:
            return self.live.text("#commission")

        def is_next() -> bool:
            return SILENT in text() or "All steps are done" in text() or (QUESTION in text() and _asked(text()) != last)

        last = ""
        while True:
            until(is_next, lambda: f"a step after {steps}: {text()}")
            if "All steps are done" in text():
                return steps
            if SILENT in text():
                self.confirmed("Continue", CARRIED)
                until(lambda: SILENT not in text(), "the session goes on")
                last = ""
            else:
                last = _asked(text())
                steps.append(last)
                self.confirmed("Agree", QUESTION)


def _asked(text: str) -> str:
    """The step that a text asks for."""
    return next((each for each in NAMES if heading(each) in text), "")


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    folder = tmp_path
    program = Path(get_package_prefix("pidtsm_experiments"), "lib", "pidtsm_experiments", "live")
    with pytest.MonkeyPatch.context() as patch, open_testbed(folder) as testbed:
        patch.setattr(heavyplant, "RATE", SLOW)
        domain, port = int(testbed.environment["ROS_DOMAIN_ID"]), free_port()
        testbed.start("controller", *ARM)
        with heavy_plant(domain) as arm, (folder / "live.log").open("w") as log:
            words = [sys.executable, str(program), "--port", str(port)]
            process = subprocess.Popen(words, cwd=folder, env=testbed.environment, stdout=log, stderr=log)
            try:
                until(lambda: "live page" in (folder / "live.log").read_text(), "the page")
                with browser(folder / "profile", in_3d=True) as page:
                    system = LiveSystem(f"http://127.0.0.1:{port}/", folder, domain, process.pid)
                    yield Scene(LivePage(page, system), arm)
            finally:
                process.terminate()
                code = process.wait(60.0)
                for session in folder.glob("results/live/commission-*"):
                    release(session)
            text = (folder / "live.log").read_text()
            assert code == 0, text
            assert "Traceback" not in text, text


def begin(scene: Scene) -> None:
    """Go on until the wrong sign is found, the session was stopped, the page opened again, and the session continues.

    Whoever closes the page stops nothing; whoever opens it again sees the same.
    """
    live, arm = scene
    scene.opened()
    live.flip("bags", on=False)
    scene.confirmed("Begin", CARRIED)
    scene.agreed("signs")
    until(lambda: "its torque is inverted" in live.text("#step-signs"), "the wrong sign")
    assert f"{INVERTED}: its torque is inverted" in live.text("#step-signs")
    assert arm.moved < 0.02
    scene.agreed("rest")
    scene.stopped()
    scene.says("The arm is held")
    at = arm.q.copy()
    live.page.open(live.system.address, 1000, 500)
    scene.opened()
    scene.says("stopped")
    assert "its torque is inverted" in live.text("#step-signs")
    assert not arm.braked
    assert np.abs(arm.q - at).max() < HELD
    scene.confirmed("Continue", CARRIED)


def end(scene: Scene) -> None:
    """Release the arm."""
    live, arm = scene
    (folder,) = live.system.folder.glob("results/live/commission-*")
    assert is_held(folder)
    scene.confirmed("Release the arm", "Commands cease")
    until(lambda: arm.braked and not is_held(folder), "the brakes")
    until(lambda: "ommissioning" not in live.text("#status"), "the controller may come back")


def test_a_commissioning_begins_stops_goes_on_and_ends_by_clicks(scene: Scene) -> None:
    begin(scene)
    scene.agreed("rest")
    scene.agreed("lateness")
    scene.stopped()
    scene.says("The arm is held")
    end(scene)


@pytest.mark.long
def test_a_whole_commissioning_by_clicks(scene: Scene) -> None:
    live = scene.live
    begin(scene)
    assert tuple(dict.fromkeys(scene.all_agreed())) == NAMES[1:]
    (folder,) = live.system.folder.glob("results/live/commission-*")
    curves = "document.querySelector('#report iframe').contentDocument.querySelectorAll('canvas').length"
    until(lambda: live.page.evaluate(f"document.querySelector('#report iframe') && {curves}"), "the plots")
    links = live.page.evaluate("[...document.querySelectorAll('#report a')].map(a => a.href)")
    assert links[0] == f"{live.system.address}{folder.name}/report.html"
    parameters = live.page.evaluate(f"fetch('{folder.name}/commission.yaml').then(answer => answer.text())")
    assert parameters == (folder / "commission.yaml").read_text()
    assert live.page.evaluate(f"fetch('{folder.name}/session.json').then(answer => answer.status)") != 200
    settings = make_experiment(None, params=str(folder / "commission.yaml")).settings["controller"]
    assert settings["compensation.coulomb"]
    end(scene)
