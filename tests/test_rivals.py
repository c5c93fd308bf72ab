"""Two nodes that publish the same: who comes second is named, and none of its torques reaches the arm."""

import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from support.rig import SECOND, Judged, Rigs, Watch, document_rows, judge
from support.testbed import Testbed

from pidtsm_experiments.runs import runner
from pidtsm_experiments.runs.runner import Process
from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.stamps import nanoseconds

PAGE = Path(__file__).parents[1] / "docs" / "faults.md"
NAMES = ["joint1", "joint2"]
RATE = 250
PARAMETERS = {"simulator": [f"rate:={RATE}"], "controller": ["watchdog.state_stop:=1.0"], "trajectory": []}
"""A quarter of the usual rate, as two systems share a machine; and a machine that stalls for a moment is no rival."""
FASTEST = 10.0  # rad/s; no motion here is half as fast, and every jump to what a rival wants is faster
CLOSE = 0.05  # rad
STALL = 0.1  # s; a third of the time for which a node listens to the others before it begins


class System:
    """An arm that is moved, and a watch over its commands and motion.

    Attributes:
        sound: no test has failed on it.
    """

    def __init__(self, testbed: Testbed) -> None:
        self.testbed = testbed
        self.sound = True
        self.running = testbed.processes.running
        self.watch = Watch(
            testbed.listener(),
            {
                "joint_states": JointState,
                "controller/state": ControllerState,
                "second/state": ControllerState,
                "joint_commands": JointState,
                "reference": JointReference,
                "/diagnostics": DiagnosticArray,
            },
        )

    def start(self, *nodes: str) -> None:
        """Start those that do not run."""
        for node in nodes:
            if node not in self.running:
                self.testbed.start(node, *PARAMETERS[node])

    def second(self, node: str) -> Process:
        """Another process of this node, with the name ``second``."""
        settings = [word for parameter in PARAMETERS[node] for word in ("-p", parameter)]
        log = self.testbed.folder / f"second-{node}.log"
        process = runner.Process(node, ["-r", f"{node}:__node:=second", *settings], self.testbed.environment, log)
        self.running["second"] = process
        return process

    def end(self, name: str) -> None:
        """End a process as Ctrl-C does."""
        process = self.running.pop(name)
        process.interrupt()
        assert process.wait() == 0

    def until(self, condition: Callable[[], Any], what: str) -> None:
        """Wait for a condition on what has arrived."""

        def holds() -> Any:
            self.watch.take()
            return condition()

        self.testbed.spin_until(holds, what)

    def logs(self, process: Process, pattern: str) -> None:
        """Wait for a text in the log of a process."""
        self.until(lambda: re.search(pattern, process.log.read_text()), f"{pattern!r} in the log of {process.name}")

    def follows(self, topic: str = "controller/state") -> None:
        """Wait until the reference has been followed for 0.2 s from now on."""
        count = len(self.watch.heard[topic])
        self.until(
            lambda: (
                len(self.watch.heard[topic]) > count + RATE // 5
                and self.watch.last(topic).mode == ControllerState.FOLLOWING
                and np.abs(self.watch.last(topic).position_error).max() < CLOSE
            ),
            f"the reference is followed, by {topic}",
        )

    def begin(self) -> None:
        """All that arrives from now on is part of the test."""
        self.sound = False
        self.start("simulator", "trajectory", "controller")
        self.follows()
        for heard in self.watch.heard.values():
            heard.clear()
        self.follows()

    def stamps(self, topic: str) -> list[int]:
        """Those of the messages of a topic, ns."""
        return [serialized_nanoseconds(data) for data in self.watch.heard[topic]]

    def longest_gap(self, topic: str) -> float:
        """The longest time between two messages of a topic by their stamps, s."""
        return float(np.diff(self.stamps(topic)).max()) / SECOND

    def undisturbed(self) -> Judged:
        """The arm got the torques of the first controller only, and made the motion of the first reference.

        Returns why the errors could not be judged, if the machine stood still.
        """
        states = self.watch.messages("controller/state")
        commanded = {tuple(state.effort) for state in states}
        first, last = (nanoseconds(states[at].header.stamp) for at in (50, -1))
        applied = [m for m in self.watch.messages("joint_states") if first < nanoseconds(m.header.stamp) < last]
        strange = [m.effort for m in applied if tuple(m.effort) not in commanded and any(m.effort)]
        assert not strange, f"{len(strange)} of {len(applied)} torques are not of the first, as {strange[0]}"
        _moves_steadily(states)
        assert {state.fault for state in states} == {ControllerState.NO_FAULT}
        return judge(states, _close)


def _moves_steadily(states: list[ControllerState]) -> None:
    """Neither what is measured nor what is desired jumps."""
    periods = np.diff([nanoseconds(state.header.stamp) for state in states])[:, None] / SECOND
    measured = np.array([state.position for state in states]).reshape(-1, len(NAMES))
    desired = measured - np.reshape([state.position_error for state in states], measured.shape)
    for motion in (measured, desired):
        assert (np.abs(np.diff(motion, axis=0)) < FASTEST * periods).all()


def _close(states: list[ControllerState]) -> None:
    assert {state.mode for state in states} == {ControllerState.FOLLOWING}
    assert np.abs([state.position_error for state in states]).max() < CLOSE


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rigs]:
    rigs = Rigs(tmp_path_factory.mktemp("systems"))
    yield rigs
    rigs.close()


def stranger(system: System, kind: Any, topic: str, witness: str) -> Judged:
    """A publisher that is no node of ours, with what the arm must not feel: far off, and always up to date."""
    publisher = system.testbed.node.create_publisher(kind, topic, 10)
    content = {"position": [1.0, 1.0], "velocity": [0.0, 0.0], "acceleration": [0.0, 0.0]}
    if topic == "joint_commands":
        content = {"effort": [100.0, -100.0]}
    elif topic == "joint_states":
        del content["acceleration"]
    states = system.watch.heard["controller/state"]
    count = len(states)

    def disturb() -> bool:
        message = kind(name=NAMES, **content)
        message.header.stamp = system.watch.last("controller/state").header.stamp
        publisher.publish(message)
        return len(states) > count + RATE

    system.until(disturb, "a second of disturbance")
    system.logs(
        system.running[witness], rf"/stranger publishes /{topic}, too|/{topic} has 2 publishers, of .*/stranger"
    )
    reader = system.running["simulator" if topic == "joint_commands" else "controller"]
    system.logs(reader, f"rejected {topic}: another node publishes this, too")
    system.until(
        lambda: any("/stranger" in s.message for m in system.watch.messages("/diagnostics") for s in m.status),
        "the stranger in the diagnostics",
    )
    not_judged = system.undisturbed()
    system.testbed.node.destroy_publisher(publisher)
    return not_judged


def second(system: System, node: str, topic: str) -> Judged:
    """A second node of a kind yields, and does not take over when the first ends."""
    rival = system.second(node)
    # Where it became active before it had discovered the first, it yields.
    system.logs(rival, rf"(not |de)activated: .*/{node}\b")
    system.logs(system.running[node], f"/second (has a publisher of|publishes) {topic}, too; end one of them")
    system.follows()
    not_judged = system.undisturbed()
    before = len(rival.log.read_text())
    system.end(node)
    system.until(lambda: system.testbed.node.count_publishers(topic) == 1, "the end of the first")
    assert "] [second]: active" not in rival.log.read_text()[before:]
    system.end("second")
    return not_judged


ROWS: dict[str, list[Callable[[System], Judged]]] = {
    "a second controller or trajectory node": [
        lambda system: second(system, "trajectory", "/reference"),
        lambda system: second(system, "controller", "/joint_commands"),
    ],
    "a stranger on `joint_commands`": [lambda system: stranger(system, JointState, "joint_commands", "controller")],
    "a stranger on `joint_states` or `reference`": [
        lambda system: stranger(system, JointState, "joint_states", "controller"),
        lambda system: stranger(system, JointReference, "reference", "trajectory"),
    ],
}


@pytest.mark.parametrize(("name", "case"), [(name, case) for name, cases in ROWS.items() for case in range(len(cases))])
def test_who_comes_second_is_named_and_not_obeyed(rigs: Rigs, name: str, case: int) -> None:
    system: System = rigs.get(System)
    system.begin()
    not_judged = ROWS[name][case](system)
    system.sound = True
    if not_judged:
        pytest.skip(not_judged)


def test_the_page_has_these_rows() -> None:
    assert document_rows(PAGE, "Two that publish the same") == list(ROWS)


@pytest.mark.parametrize(("node", "topic"), [("controller", "joint_commands"), ("trajectory", "reference")])
def test_of_two_that_start_together_one_publishes(testbed: Testbed, node: str, topic: str) -> None:
    """The arm starts last: both become able to publish at the same moment."""
    system = System(testbed)
    system.start("controller", "trajectory")
    both = [system.running[node], system.second(node)]
    for process in both:
        system.logs(process, "has a publisher of")
    # Each knows the other, and waits for longer than it would listen to it.
    count = len(system.watch.heard["/diagnostics"])
    system.until(lambda: len(system.watch.heard["/diagnostics"]) > count + 4, "a second")
    system.start("simulator")
    system.until(lambda: any("activated: " in process.log.read_text() for process in both), "one yields")
    follower = both["activated: " in both[0].log.read_text()] if node == "controller" else system.running["controller"]
    system.follows("second/state" if follower is system.running["second"] else "controller/state")
    # A listener may learn of the arm later than the controller does.
    system.until(lambda: len(system.watch.heard["joint_states"]) > 100, "the joint states")
    if system.longest_gap("joint_states") > STALL:
        pytest.skip("the machine stood still: the one that should begin may have been late")
    stamps = system.stamps(topic)
    assert len(stamps) == len(set(stamps)), "both have published"


def test_a_controller_that_was_killed_is_soon_replaced(testbed: Testbed) -> None:
    """Its publisher remains listed for 20 s."""
    system = System(testbed)
    system.start("simulator", "trajectory", "controller")
    system.follows()
    killed = system.running.pop("controller")
    killed.process.send_signal(signal.SIGKILL)
    killed.wait()
    system.second("controller")
    system.follows("second/state")
    assert testbed.node.count_publishers("joint_commands") == 2
