"""The fault matrix of the whole system in realtime: processes are killed, stopped, interrupted and starved.

Simulator, trajectory, controller and recorder run as they do for users. Expected are conditions, and times of the
data's own stamps. Where those show that the machine stood still, wrong torques and errors are reported as skipped:
`test_faults.py` and `test_same_bits.py` judge the same in lockstep.
"""

import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import Popen
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from support.rig import SECOND, Judged, Rigs, Watch, document_rows, gravity, judge
from support.testbed import Testbed

from pidtsm_msgs.msg import ControllerState, JointReference
from pidtsm_ros.cdr import serialized_nanoseconds
from pidtsm_ros.stamps import nanoseconds

PAGE = Path(__file__).parents[1] / "docs" / "faults.md"
STEP = 10.0  # N m
CLOSE = 0.02  # rad
RATE = 250
"""Hz; a quarter of the usual, as all of it shares a machine with other tests."""
PATIENCE = 1.0  # s; a machine that stalls for a moment is no fault here
FOLLOWING, HOLDING, STOPPED = ControllerState.FOLLOWING, ControllerState.HOLDING, ControllerState.STOPPED


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rigs]:
    rigs = Rigs(tmp_path_factory.mktemp("systems"))
    yield rigs
    rigs.close()


class System:
    """The whole system under way, and a watch over all its topics.

    Attributes:
        sound: no test has failed on it.
    """

    def __init__(self, testbed: Testbed) -> None:
        self.testbed = testbed
        self.sound = True
        topics = {
            "joint_states": JointState,
            "reference": JointReference,
            "joint_commands": JointState,
            "controller/state": ControllerState,
            "simulator/ground_truth": JointState,
            "/diagnostics": DiagnosticArray,
        }
        self.watch = Watch(testbed.listener(), topics)
        self._bags = 0
        self._logged: dict[str, int] = {}
        for node in ("simulator", "trajectory", "controller", "recorder"):
            self.start(node)

    def start(self, node: str) -> None:
        self._logged[node] = 0
        parameters = []
        if node == "controller":
            # It waits for simulator, recorder and the test, which receives its first state.
            parameters = [f"watchdog.state_stop:={PATIENCE}", "start.subscribers:=3"]
        elif node == "simulator":
            parameters = [f"rate:={RATE}"]
        elif node == "recorder":
            self._bags += 1
            parameters = [f"output:={self.testbed.folder / f'bag{self._bags}'}"]
        self.testbed.start(node, *parameters)

    def kill(self, node: str) -> None:
        process = self.testbed.processes.running.pop(node)
        process.process.kill()
        process.wait()

    def send(self, node: str, number: signal.Signals) -> None:
        self.testbed.processes.running[node].process.send_signal(number)

    def until(self, condition: Callable[[], Any], what: str) -> None:
        """Wait for a condition on what is heard."""

        def holds() -> Any:
            self.watch.take()
            return condition()

        self.testbed.spin_until(holds, what)

    def logs(self, node: str, text: str) -> None:
        """Wait for a text in the log of a node since the row began."""
        log = self.testbed.processes.running[node].log
        self.until(lambda: text in log.read_text()[self._logged[node] :], f"{text!r} in the log of {node}")

    def state(self, condition: Callable[[ControllerState], bool], what: str) -> ControllerState:
        """A state of the controller from now on."""
        now, heard = time.time_ns(), self.watch.heard["controller/state"]

        def arrived() -> bool:
            return bool(
                heard and serialized_nanoseconds(heard[-1]) > now and condition(self.watch.last("controller/state"))
            )

        self.until(arrived, what)
        return self.watch.last("controller/state")

    def brakes(self) -> None:
        """Wait until the simulator's brakes hold the arm."""
        heard = self.watch.heard["simulator/ground_truth"]
        count = len(heard)
        self.until(
            lambda: len(heard) > count and not any(self.watch.last("simulator/ground_truth").effort), "the brakes"
        )
        # Of brakes that move again within a second the log gets one line.
        log = self.testbed.processes.running["simulator"].log
        self.until(lambda: _brake_lines(log)[-1:] == ["the brakes stop the arm"], "the brakes in the log")

    def follows(self) -> None:
        """Wait until the reference is followed; a machine that stalls for long latches a fault, which is reset."""

        def close(state: ControllerState) -> bool:
            return state.mode == FOLLOWING and max(map(abs, state.position_error)) < CLOSE

        for _ in range(10):
            state = self.state(lambda state: close(state) or state.mode == STOPPED, "the reference is followed")
            if state.mode == FOLLOWING:
                return
            assert state.fault == ControllerState.STATE_STALE
            self.reset()
        pytest.fail("faults again and again")

    def pass_time(self, seconds: float, topic: str = "simulator/ground_truth") -> None:
        """Let so much of a topic's time pass, from its next message on."""
        heard = self.watch.heard[topic]
        count = len(heard)
        self.until(
            lambda: (
                len(heard) > count
                and serialized_nanoseconds(heard[-1]) - serialized_nanoseconds(heard[count]) > seconds * SECOND
            ),
            f"{seconds} s of {topic}",
        )

    def reset(self) -> None:
        assert self.testbed.call(Trigger, "controller/reset_fault", Trigger.Request()).success

    @contextmanager
    def row(self) -> Iterator[None]:
        """A row of the table: it begins and ends with a system that runs, and nothing bad was ever published."""
        self.sound = False
        self.follows()
        self._logged = {name: len(process.log.read_text()) for name, process in self.testbed.processes.running.items()}
        yield
        self.follows()
        self.testbed.processes.check()
        for process in self.testbed.processes.running.values():
            assert "Traceback" not in process.log.read_text()
        self.until(lambda: self.watch.heard["/diagnostics"], "diagnostics")
        self.watch.check()
        self.sound = True


def _brake_lines(log: Path) -> list[str]:
    """Lines of the log of the simulator about its brakes."""
    return re.findall("the brakes stop the arm|brakes released", log.read_text())


def restart_controller(system: System) -> Judged:
    system.kill("controller")
    system.brakes()
    system.pass_time(0.5)
    count = len(system.watch.heard["controller/state"])
    system.start("controller")
    system.pass_time(2.0, "controller/state")
    return judge(system.watch.messages("controller/state", count), check_restart)


def check_restart(states: list[ControllerState]) -> None:
    """The first two seconds of a controller: no step of torque, and close to the reference after one of them."""
    efforts = np.array([state.effort for state in states])
    held = np.array(states[0].position)
    desired = held - states[0].position_error
    if states[0].period == 0.0:  # Otherwise the first states were sent before this listener was found.
        np.testing.assert_allclose(desired, held, atol=1e-9, err_msg="it begins where the arm is")
        assert np.abs(efforts[0] - gravity(held)).max() < STEP
    assert np.abs(np.diff(efforts, axis=0)).max() < STEP
    stamps = np.array([nanoseconds(state.header.stamp) for state in states]) / SECOND
    begun = np.argmax([state.mode == FOLLOWING for state in states])
    late = stamps > stamps[begun] + 1.0
    assert late.any()
    assert np.abs([state.position_error for state in states])[late].max() < CLOSE


def ends_safely(system: System) -> None:
    """The controller's last commands, of their own accord, carry the arm."""
    commands, states = system.watch.heard["joint_commands"], system.watch.heard["controller/state"]

    def carried() -> bool:
        # They have the stamp of the command before them.
        if len({serialized_nanoseconds(data) for data in (*commands[-2:], states[-1])}) > 1:
            return False
        needed = gravity(system.watch.last("controller/state").position)
        return bool(np.abs(system.watch.last("joint_commands").effort - needed).max() < STEP)

    system.until(carried, "the safe torque")


def restart_simulator(system: System) -> None:
    system.kill("simulator")
    system.logs("controller", "stopped: no joint state for")
    ends_safely(system)
    system.start("simulator")
    state = system.state(lambda state: True, "the controller answers")
    assert (state.mode, state.fault) == (STOPPED, ControllerState.STATE_STALE), "latched"
    system.reset()


def stop_simulator(system: System) -> None:
    truth = system.watch.heard["simulator/ground_truth"]
    count = len(truth)
    system.send("simulator", signal.SIGSTOP)
    system.logs("controller", "stopped: no joint state for")
    system.send("simulator", signal.SIGCONT)
    system.pass_time(0.1)
    messages = system.watch.messages("simulator/ground_truth", count)
    stop = np.diff([nanoseconds(message.header.stamp) for message in messages]).argmax()
    before, after = messages[stop], messages[stop + 1]
    # Its motors held the last torque no longer than command.timeout.
    assert np.abs(np.subtract(after.position, before.position)).max() < 0.05
    state = system.state(lambda state: True, "the controller answers")
    assert (state.mode, state.fault) == (STOPPED, ControllerState.STATE_STALE), "latched"
    system.reset()


def stay_calm(system: System, act: Callable[[], None]) -> Judged:
    """Two seconds in which the controller goes on as if nothing had happened."""
    count = len(system.watch.heard["controller/state"])
    act()
    system.pass_time(2.0)

    def check(states: list[ControllerState]) -> None:
        assert all(state.mode == FOLLOWING for state in states)
        assert np.abs([state.position_error for state in states]).max() < CLOSE
        assert np.abs(np.diff([state.effort for state in states], axis=0)).max() < STEP

    return judge(system.watch.messages("controller/state", count), check)


def kill_recorder(system: System) -> Judged:
    def act() -> None:
        # It is connected, and has something to lose.
        bag = system.testbed.folder / f"bag{system._bags}" / f"bag{system._bags}_0.mcap"
        system.until(lambda: bag.exists() and bag.stat().st_size > 10_000, "a recording")
        system.kill("recorder")

    judged = stay_calm(system, act)
    system.start("recorder")
    return judged


def restart_trajectory(system: System) -> None:
    system.kill("trajectory")
    system.state(lambda state: state.mode == HOLDING, "the position is held")
    system.logs("controller", "holding position: the reference is")
    system.pass_time(0.5)
    state = system.state(lambda state: True, "it has come to rest")
    system.pass_time(0.5)
    later = system.state(lambda state: True, "half a second later")
    assert later.mode == HOLDING
    assert np.abs(np.subtract(state.position, later.position)).max() < CLOSE
    system.start("trajectory")


def starve_trajectory(system: System) -> Judged:
    """Less than it needs to answer every joint state."""

    def act() -> None:
        for _ in range(100):
            system.send("trajectory", signal.SIGSTOP)
            time.sleep(0.02)
            system.send("trajectory", signal.SIGCONT)
            time.sleep(0.002)

    return stay_calm(system, act)


def stop_controller(system: System) -> None:
    for seconds in (0.5, 5.0):
        system.follows()
        system.testbed.set("controller", {"watchdog.state_stop": 0.02})
        system.send("controller", signal.SIGSTOP)
        system.pass_time(seconds)
        system.brakes()
        system.send("controller", signal.SIGCONT)
        system.state(lambda state: state.fault == ControllerState.STATE_STALE, "the gap is a fault")
        count = len(system.watch.heard["controller/state"])
        system.pass_time(0.5, "controller/state")
        states = system.watch.messages("controller/state", count)
        assert {state.mode for state in states} == {STOPPED}, "latched"
        system.testbed.set("controller", {"watchdog.state_stop": PATIENCE})
        system.reset()
    logged = system.testbed.processes.running["controller"].log.read_text()[system._logged["controller"] :]
    assert "clock was set" not in logged


def hog(system: System) -> None:
    busy = [Popen(["timeout", "60", sys.executable, "-c", "while True: pass"]) for _ in range(os.cpu_count() or 1)]
    try:
        system.pass_time(3.0)
    finally:
        for process in busy:
            process.terminate()
            process.wait()
    system.follows()


def interrupt_controller(system: System) -> None:
    process = system.testbed.processes.running.pop("controller")
    process.interrupt()
    assert process.wait() == 0
    ends_safely(system)
    system.brakes()
    system.start("controller")


ROWS: dict[str, Callable[[System], Judged]] = {
    "controller killed and started again": restart_controller,
    "controller stopped (SIGSTOP) and continued": stop_controller,
    "controller interrupted (SIGINT) and started again": interrupt_controller,
    "simulator killed and started again": restart_simulator,
    "simulator stopped (SIGSTOP) and continued": stop_simulator,
    "trajectory killed and started again": restart_trajectory,
    "trajectory short of processor time": starve_trajectory,
    "recorder killed": kill_recorder,
    "every core busy": hog,
}


@pytest.mark.parametrize("name", ROWS)
def test_the_system(rigs: Rigs, name: str) -> None:
    system: System = rigs.get(System)
    with system.row():
        not_judged = ROWS[name](system)
    if not_judged:
        pytest.skip(not_judged)


def test_the_page_has_these_rows() -> None:
    assert document_rows(PAGE, "The whole system") == list(ROWS)
