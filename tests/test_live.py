"""What the live page does with the nodes, as the messages of a browser make it do it."""

import os
import random
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix
from liveclient import LiveClient, live_client
from livepage import LiveSystem, free_port, live_process, parameter, until
from testbed import Testbed

from pidtsm_core.experiment import make_experiment
from pidtsm_core.node_parameters import NODE_SCHEMAS
from pidtsm_experiments.bags.reader import read_recording

EVENTS = int(os.environ.get("PIDTSM_LIVE_EVENTS", "300"))
"""Number of random events."""
NASTY = ("", "-1", "0", "nan", ".inf", "1e300", "1, 2, 3", "[[1]]", "a: b", "💥", "0.5", "2, 3", "true", "- -")


class Live:
    """A system, and one connection to its page."""

    def __init__(self, system: LiveSystem, client: LiveClient) -> None:
        self.system, self.client = system, client

    def text(self, word: str) -> str:
        """The text of the element that contains a word."""
        return re.sub("<[^>]+>", " ", self.client.shown(word))

    @property
    def status(self) -> str:
        return self.text('id="status"')

    @property
    def marks(self) -> set[str]:
        """When marks were set, of those that are shown."""
        return set(re.findall(r"(\d\d:\d\d:\d\d)\s+mark", self.text('id="events"')))

    def follows(self) -> None:
        until(lambda: "Following" in self.status, lambda: f"the arm follows, not {self.status}")


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    with live_process(tmp_path_factory.mktemp("live")) as system, live_client(system.address) as client:
        found = Live(system, client)
        found.follows()
        yield found


def test_two_browsers_show_the_same_and_closing_one_changes_nothing(live: Live) -> None:
    with live_client(live.system.address) as other:
        until(lambda: other.shown('id="status"'), "the other shows the page")
        other.enter("kd", "0.6")
        other.submit("law")
        until(lambda: live.client.find("kd")["value"] == "0.6", "the first shows it")
        until(lambda: "law.kd = 0.6" in live.text("law.kd"), "and that it is set")
    live.follows()
    assert parameter(live.system, "law.kd") == 0.6


def test_a_frozen_controller_goes_on(live: Live) -> None:
    live.client.press("Freeze the controller")
    until(lambda: "No state of the controller" in live.status, "its silence")
    live.client.press("Let it go on")
    # If its watchdog runs before it reads what has arrived meanwhile, it has stopped.
    until(lambda: "Following" in live.status or "Stopped: no joint state" in live.status, lambda: live.status)
    if "Stopped" in live.status:
        live.client.press("Reset the fault")
    live.follows()


def test_a_recording_can_be_read(live: Live) -> None:
    live.client.press("Record")
    until(lambda: re.search(r"recording, [1-9]\d+ samples", live.text('id="bag"')), "samples")
    live.client.press("End the recording")
    text = until(lambda: "recorded: " in live.text('id="bag"') and live.text('id="bag"'), "its end")
    recording = read_recording(Path(text.partition("recorded: ")[2].strip()))
    assert recording.joints == ("joint1", "joint2")


def test_a_new_start_keeps_the_gains_and_saved_gains_can_be_run(live: Live) -> None:
    live.client.enter("k1", "3.5, 2.5")
    live.client.submit("law")
    until(lambda: "law.k1 = 3.5, 2.5" in live.text("law.k1"), "the gain is set")
    live.client.press("Kill the controller")
    until(lambda: "killed by signal 9" in live.status, "the end of the controller")
    live.client.press("Activate")
    live.follows()
    assert parameter(live.system, "law.k1") == (3.5, 2.5)
    live.client.press("Save these gains")
    text = until(lambda: live.text('id="gains"'), "the path")
    file = Path(text.partition("saved: ")[2].strip())
    assert file.is_relative_to(live.system.folder)
    values = make_experiment("case1", params=[str(file)]).resolved(NODE_SCHEMAS)["controller"]
    assert values["law.k1"] == (3.5, 2.5)


def test_another_law_is_used_after_a_new_start(live: Live) -> None:
    dropdowns = [e for e in live.client.elements.values() if e["type"] == "GuiDropdownMessage"]
    law = next(e["uuid"] for e in dropdowns if e["props"]["label"] == "law")
    live.client.send({"type": "GuiUpdateMessage", "uuid": law, "updates": {"value": "computed_torque"}})
    live.client.submit("law")
    until(lambda: "controller started again" in live.text('id="events"'), "the new start")
    assert parameter(live.system, "law.name") == "computed_torque"


def test_random_events_leave_the_system_running(live: Live) -> None:
    """Values of every kind in every control, in any order, and connections that close."""
    dice = random.Random(1)
    client, without = live.client, ("Kill the controller", "Freeze the controller", "Record", "Save these gains")
    elements = [e for e in client.elements.values() if "label" in e["props"] and e["props"]["label"] not in without]
    for count in range(EVENTS):
        element = dice.choice(elements)
        if element["type"] == "GuiFormMessage":
            client.send({"type": "GuiFormSubmitMessage", "uuid": element["uuid"]})
        elif element["type"] == "GuiButtonMessage":
            client.press(element["props"]["label"])
        elif element["type"] in ("GuiTextMessage", "GuiDropdownMessage"):
            client.send({"type": "GuiUpdateMessage", "uuid": element["uuid"], "updates": {"value": dice.choice(NASTY)}})
        elif element["type"] in ("GuiNumberMessage", "GuiVector3Message"):
            value = dice.choice([-1e9, 0.0, 1e-9, 1.0, 1e12, float("nan"), float("inf")])
            value = value if element["type"] == "GuiNumberMessage" else [value, 0.0, value]  # type: ignore[assignment]
            client.send({"type": "GuiUpdateMessage", "uuid": element["uuid"], "updates": {"value": value}})
        if count % 100 == 50:
            with live_client(live.system.address):
                pass
    earlier = live.marks

    def marked() -> bool:
        client.press("Mark")  # Again and again: what the events have left to do may hide a single one.
        return bool(live.marks - earlier)

    until(marked, lambda: f"the page goes on: {live.status}")
    print(live.text('id="events"'), live.status)
    for schema in NODE_SCHEMAS["controller"]({"law.name": parameter(live.system, "law.name")}):
        if schema.name in ("law.k1", "limits.effort", "stop.bandwidth", "watchdog.reference"):
            schema.check(parameter(live.system, schema.name), 2)


def test_the_page_of_a_real_arm_breaks_nothing_and_asks_before_it_moves(testbed: Testbed, tmp_path: Path) -> None:
    """Real is what has no simulator; here, the arm is missing altogether."""
    testbed.start("controller", "autostart:=false")
    program = Path(get_package_prefix("pidtsm_experiments"), "lib", "pidtsm_experiments", "live")
    port = free_port()
    with (tmp_path / "live.log").open("w") as log:
        process = subprocess.Popen(
            [sys.executable, program, "--port", str(port)],
            cwd=tmp_path,
            env=testbed.environment,
            stdout=log,
            stderr=log,
        )
    try:
        until(lambda: "live page" in (tmp_path / "live.log").read_text(), "the page")
        with live_client(f"http://127.0.0.1:{port}") as client:
            until(lambda: "REAL" in client.shown('id="status"'), "the page says so")
            until(lambda: any(e["props"].get("label") == "Activate" for e in client.elements.values()), "its buttons")
            labels = {e["props"].get("label") for e in client.elements.values()}
            assert labels.isdisjoint({"Push", "Pick up", "Kill the controller", "Freeze the controller", "bits", "law"})
            client.press("Activate")
            until(lambda: any(e["props"].get("label") == "Cancel" for e in client.elements.values()), "a question")
            assert "activated" not in client.shown('id="events"')
    finally:
        process.terminate()
        assert process.wait(60.0) == 0, (tmp_path / "live.log").read_text()
