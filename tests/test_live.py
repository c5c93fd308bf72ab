"""What the live page does with the nodes, as the messages of a browser make it do it."""

import os
import random
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from ament_index_python.packages import get_package_prefix
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import JointState
from support.judges import judged, received
from support.liveclient import LiveClient, live_client
from support.livepage import LiveSystem, free_port, live_process, parameter, until
from support.testbed import Testbed, open_testbed

from pidtsm_core.control import LAW_NAME
from pidtsm_core.experiment import make_experiment
from pidtsm_core.experiment.node_parameters import NODE_SCHEMAS
from pidtsm_experiments.bags.reader import read_recording
from pidtsm_experiments.bags.recorder_node import BARRIER, TOPICS

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


def test_changes_are_undone_one_by_one_and_all_together(live: Live) -> None:

    def change(value: str) -> None:
        live.client.enter("kd", value)
        live.client.submit("law")
        until(lambda: f"→ {value}" in live.text('id="changes"'), "the change in the history")

    for value in ("0.7", "0.8", "0.9"):
        change(value)
    live.client.press("Undo")
    until(lambda: live.client.find("kd")["value"] == "0.8", "the value before, in its field")
    assert parameter(live.system, "law.kd") == 0.8
    start = live.text('id="changes"').rpartition("law.kd: ")[2].partition(" ")[0]
    live.client.press("All back to the start")
    until(lambda: live.client.find("kd")["value"] == start, "the value from the start")
    assert parameter(live.system, "law.kd") == float(start)
    until(lambda: "→" not in live.text('id="changes"'), "an empty history")


def test_a_dead_simulator_is_named_and_the_arm_stays_simulated(live: Live) -> None:
    live.system.kill("simulator")
    until(lambda: "simulator was killed by signal 9 at" in live.status, lambda: live.status)
    until(lambda: "0 commands per second · no data since" in live.status, lambda: live.status)
    assert "simulator  dead: was killed by signal 9" in live.text('id="nodes"')
    assert "SIMULATED" in live.status
    live.client.press("Activate")
    answer = "answers that it is active; nothing was changed. But simulator was killed by signal 9"
    until(lambda: answer in live.text('id="events"'), lambda: live.text('id="events"'))
    live.client.press("Start simulator again")
    until(lambda: "simulator  alive" in live.text('id="nodes"'), lambda: live.text('id="nodes"'))
    until(lambda: "Stopped: no joint state" in live.status, lambda: live.status)
    live.client.press("Reset the fault")
    live.follows()
    assert "no data" not in live.status


def test_a_dead_trajectory_node_is_named_and_started_again(live: Live) -> None:
    live.system.kill("trajectory")
    until(lambda: "trajectory  dead: was killed by signal 9" in live.text('id="nodes"'), "its end")
    live.client.press("Go")
    until(lambda: "refused: trajectory was killed" in live.text('id="events"'), lambda: live.text('id="events"'))
    live.client.press("Start trajectory again")
    live.follows()
    until(lambda: "trajectory  alive" in live.text('id="nodes"'), lambda: live.text('id="nodes"'))
    live.client.press("Start trajectory again")
    until(lambda: "trajectory runs; only a node that has ended" in live.text('id="events"'), "a refusal")


def test_a_frozen_controller_goes_on(live: Live) -> None:
    live.client.press("Freeze the controller")
    until(lambda: "No state of the controller" in live.status, "its silence")
    live.client.press("Let it go on")
    # If its watchdog runs before it reads what has arrived meanwhile, it has stopped.
    until(lambda: "Following" in live.status or "Stopped: no joint state" in live.status, lambda: live.status)
    if "Stopped" in live.status:
        live.client.press("Reset the fault")
    live.follows()


def test_a_recording_can_be_read_by_everyone(live: Live) -> None:

    def samples() -> int:
        found = re.search(r"recording, (\d+) samples", live.text('id="bag"'))
        return int(found[1]) if found else 0

    def pushed() -> bool:
        live.client.press("Push")  # Again and again: the recorder may not have discovered yet who publishes this topic.
        return samples() > before + 500

    live.client.press("Record")
    before = until(samples, "samples")
    until(pushed, "more of them")
    live.client.press("End the recording")
    text = until(lambda: "recorded: " in live.text('id="bag"') and live.text('id="bag"'), "its end")
    bag = Path(text.partition("recorded: ")[2].strip())
    # The beginning, of whatever length: a busy recorder receives many messages at one moment.
    counts = judged(bag, 1 + max(received(bag, "/simulator/push")[0], received(bag, f"/{BARRIER}")[100]))
    assert min(counts[topic] for topic in TOPICS) >= 100
    assert counts["simulator/push"] >= 1
    assert read_recording(bag).joints == ("joint1", "joint2")


def test_a_bag_whose_recorder_was_killed_is_not_called_recorded(live: Live) -> None:
    live.client.press("Record")
    until(lambda: "recording, " in live.text('id="bag"'), "its begin")
    live.system.kill("recorder")
    cause = "recorded without its end, because the recorder was killed by signal 9: "
    until(lambda: cause in live.text('id="bag"'), lambda: live.text('id="bag"'))


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
    values = make_experiment("case1", params=[str(file)]).node_values({})["controller"]
    assert values["law.k1"] == (3.5, 2.5)


def test_another_law_is_used_after_a_new_start(live: Live) -> None:
    def changed() -> bool:
        dropdowns = [e for e in live.client.elements.values() if e["type"] == "GuiDropdownMessage"]
        law = next((e for e in dropdowns if e["props"]["label"] == "law"), None)
        if law is not None and law["value"] != "computed_torque":
            # The page shows what a node has that was away and is back, which takes an entry back that is not submitted.
            law["value"] = "computed_torque"
            live.client.send({"type": "GuiUpdateMessage", "uuid": law["uuid"], "updates": {"value": law["value"]}})
            live.client.submit("law")
        return "→ computed_torque" in live.text('id="changes"')

    until(changed, lambda: live.text('id="events"'))
    assert parameter(live.system, "law.name") == "computed_torque"
    live.client.press("Undo")
    until(lambda: "undone: controller law.name" in live.text('id="events"'), lambda: live.text('id="events"'))
    assert parameter(live.system, "law.name") == LAW_NAME.default
    assert parameter(live.system, "law.k1") == (3.5, 2.5)


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

    def brought_back() -> bool:
        """A commissioning may have taken the controller away, and a reference may rest far from the arm.

        Whoever changes nodes waits for whoever did so before.
        """
        for label in ("Stop", "Release the arm", "Go to the arm", "Activate"):
            client.press(label)
        return live.text('id="events"').count("it is active; nothing was changed") > 1

    until(marked, lambda: f"the page goes on: {live.status}")
    until(brought_back, lambda: f"the controller comes back: {live.status}")
    print(live.text('id="events"'), live.status)
    for schema in NODE_SCHEMAS["controller"]({"law.name": parameter(live.system, "law.name")}):
        if schema.name in ("law.k1", "limits.effort", "stop.bandwidth", "watchdog.reference"):
            schema.check(parameter(live.system, schema.name), 2)


class Real(NamedTuple):
    """The page of a system without a simulator, that somebody else has started."""

    testbed: Testbed
    client: LiveClient

    def text(self, word: str) -> str:
        """The text of the element that contains a word."""
        return re.sub("<[^>]+>", " ", self.client.shown(word))

    def k1(self) -> float:
        """The gain of the running controller."""
        request = GetParameters.Request(names=["law.k1"])
        found = self.testbed.call(GetParameters, "controller/get_parameters", request)
        return float(found.values[0].double_value)

    def questions(self) -> list[str]:
        """The texts of the open dialogs."""
        markdown = [e for e in tuple(self.client.elements.values()) if e["type"] == "GuiMarkdownMessage"]
        return [str(e["props"]["_markdown"]) for e in markdown if "out of its reach" in str(e["props"]["_markdown"])]


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Real]:
    """Real is what has no simulator; here, the arm is missing altogether at first."""
    folder = tmp_path_factory.mktemp("real")
    program = Path(get_package_prefix("pidtsm_experiments"), "lib", "pidtsm_experiments", "live")
    with open_testbed(folder) as testbed, (folder / "live.log").open("w") as log:
        testbed.start("controller", "autostart:=false")
        port = free_port()
        process = subprocess.Popen(
            [sys.executable, program, "--port", str(port)],
            cwd=folder,
            env=testbed.environment,
            stdout=log,
            stderr=log,
        )
        try:
            until(lambda: "live page" in (folder / "live.log").read_text(), "the page")
            with live_client(f"http://127.0.0.1:{port}") as client:
                yield Real(testbed, client)
        finally:
            process.terminate()
            assert process.wait(60.0) == 0, (folder / "live.log").read_text()


def test_the_page_of_a_real_arm_breaks_nothing_and_asks_before_it_moves(real: Real) -> None:
    until(lambda: "REAL" in real.client.shown('id="status"'), "the page shows it")
    until(lambda: any(e["props"].get("label") == "Activate" for e in real.client.elements.values()), "its buttons")
    labels = {e["props"].get("label") for e in real.client.elements.values()}
    assert labels.isdisjoint({"Push", "Pick up", "Kill the controller", "Freeze the controller", "bits", "law"})
    real.client.press("Activate")
    until(real.questions, "a question")
    assert "activated" not in real.client.shown('id="events"')
    real.client.press("Cancel")
    until(lambda: not real.questions(), "the end of the question")


def test_a_real_arm_changes_by_more_than_the_factor_only_after_a_question(real: Real) -> None:
    until(lambda: real.client.find("k1")["value"] == "3", "its field")
    real.testbed.set("controller", {"law.k1": 2.0})
    until(lambda: real.client.find("k1")["value"] == "2", "what somebody else has changed, in its field")
    until(lambda: "law.k1: 3 → 2 (by another program)" in real.text('id="changes"'), "the same in the history")

    def enter(value: str) -> None:
        real.client.enter("k1", value)
        real.client.submit("law")

    enter("6.0")
    until(lambda: "law.k1: 2 → 6" in real.text('id="changes"'), lambda: f"no question: {real.questions()}")
    enter("30.0")
    assert "law.k1: 6 → 30" in until(real.questions, "a question")[0]
    assert real.k1() == 6.0
    real.client.press("Change it")
    until(lambda: "law.k1: 6 → 30" in real.text('id="changes"'), "the change")
    assert real.k1() == 30.0
    real.client.press("Undo")
    until(lambda: real.client.find("k1")["value"] == "6", "the value before, without a question")
    assert real.k1() == 6.0


def test_a_trajectory_node_that_comes_after_the_page_gets_its_controls(real: Real) -> None:
    def labels() -> set[str]:
        return {e["props"].get("label") for e in real.client.elements.values()}

    assert "Go" not in labels()
    process = real.testbed.start("trajectory")
    until(lambda: "Go" in labels(), "the controls of its motion")
    process.interrupt()
    assert process.wait() == 0


def test_a_silent_arm_and_a_silent_controller_are_named_with_what_starts_them(real: Real) -> None:
    arm = real.testbed.node.create_publisher(JointState, "joint_states", 10)

    def heard() -> bool:
        arm.publish(JointState(name=["joint1", "joint2"], position=[0.0, 0.0]))
        return "stranger  alive" in real.text('id="nodes"')

    until(heard, lambda: real.text('id="nodes"'))
    assert "REAL ARM" in real.text('id="status"')
    assert "not seen" not in real.text('id="status"')
    until(lambda: "stranger  silent since" in real.text('id="nodes"'), lambda: real.text('id="nodes"'))
    configure = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE))
    assert real.testbed.call(ChangeState, "controller/change_state", configure).success
    until(lambda: "controller  alive" in real.text('id="nodes"'), lambda: real.text('id="nodes"'))
    real.testbed.processes.running["controller"].process.kill()
    real.client.press("Deactivate")
    until(lambda: "controller did not answer" in real.text('id="events"'), lambda: real.text('id="events"'))
    assert "deactivated" not in real.text('id="events"')
    until(lambda: "ros2 run pidtsm_controller controller" in real.text('id="nodes"'), lambda: real.text('id="nodes"'))
    assert "controller  silent since" in real.text('id="nodes"')
