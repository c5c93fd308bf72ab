"""Every node's process ends cleanly on request, at any moment, and gets its messages by UDP."""

import signal
import time
from contextlib import suppress
from pathlib import Path

import pytest
from lifecycle_msgs.srv import GetState
from support.testbed import Testbed

from pidtsm_experiments.runs.runner import Process
from pidtsm_msgs.msg import ControllerState


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("node", ["simulator", "controller", "trajectory"])
def test_a_signal_ends_a_started_node_cleanly(testbed: Testbed, node: str, number: signal.Signals) -> None:
    process = testbed.start(node)

    def is_started() -> bool:
        label = testbed.call(GetState, f"{node}/get_state", GetState.Request()).current_state.label
        # A controller becomes active with the first joint state.
        return bool(label == ("inactive" if node == "controller" else "active"))

    testbed.spin_until(is_started, f"{node} has started")
    process.process.send_signal(number)
    assert process.wait() == 0
    assert "Traceback" not in process.log.read_text()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_controller_ends_although_a_reader_is_suspended(testbed: Testbed, number: signal.Signals) -> None:
    """A recorder that is suspended acknowledges nothing; another signal meanwhile changes nothing."""
    testbed.start("simulator", "rate:=250")
    testbed.start("trajectory")
    recorder = testbed.start("recorder", f"output:={testbed.folder / 'bag'}")
    controller = testbed.start("controller", "start.subscribers:=2")
    states = testbed.hear(ControllerState, "controller/state")
    testbed.spin_until(lambda: states, "an active controller")
    recorder.process.send_signal(signal.SIGSTOP)
    count = len(states)
    testbed.spin_until(lambda: len(states) > count + 10, "messages that the recorder lacks")
    controller.process.send_signal(number)
    testbed.spin_until(lambda: "has not received every message" in controller.log.read_text(), "the end begins")
    with suppress(ProcessLookupError):  # It may have ended by now.
        controller.process.send_signal(number)
    assert controller.wait() == 0
    recorder.process.send_signal(signal.SIGCONT)


def takes_signals(process: Process) -> bool:
    """It has replaced Python's handlers; that of SIGINT alone is always there."""
    status = Path(f"/proc/{process.process.pid}/status").read_text()
    caught = int(next(line for line in status.splitlines() if line.startswith("SigCgt")).split()[1], 16)
    return bool(caught >> (signal.SIGTERM - 1) & 1)


@pytest.mark.parametrize("node", ["simulator", "controller", "trajectory", "recorder", "visualization", "composed"])
@pytest.mark.parametrize("after", [0.0, 0.3, 0.8])
def test_a_signal_at_any_moment_of_the_start_ends_a_node_cleanly(testbed: Testbed, node: str, after: float) -> None:
    process = testbed.start_executable(node, *([f"output:={testbed.folder / 'bag'}"] if node == "recorder" else []))
    testbed.spin_until(lambda: takes_signals(process), f"{node} takes signals")
    time.sleep(after)  # What happens at this moment is left to chance.
    process.interrupt()
    assert process.wait() == 0
    assert "Traceback" not in process.log.read_text()


@pytest.mark.parametrize("discovery", ["LOCALHOST", "SUBNET"])
def test_messages_come_in_by_udp_alone(testbed: Testbed, discovery: str) -> None:
    """Shared memory has locks, which a reader that is killed leaves closed, and to open it stops all for 0.3 s."""
    testbed.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = discovery
    process = testbed.start("simulator")
    testbed.spin_until(lambda: "active" in process.log.read_text(), "the simulator is active")
    threads = Path(f"/proc/{process.process.pid}/task").glob("*/comm")
    kinds = {name.split(".")[1] for file in threads if (name := file.read_text()).startswith("dds.")}
    assert "udp" in kinds
    assert "shm" not in kinds


def test_recorder_says_why_it_cannot_write(testbed: Testbed) -> None:
    occupied = testbed.folder / "bag"
    occupied.mkdir()
    process = testbed.start("recorder", f"output:={occupied}")
    assert process.wait() == 1
    lines = process.log.read_text().splitlines()
    assert len(lines) == 1
    assert "cannot record" in lines[0]
    assert str(occupied) in lines[0]
