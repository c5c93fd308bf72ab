"""Every node's process ends cleanly when asked, at any moment."""

import signal

import pytest
from bench import Bench
from lifecycle_msgs.srv import GetState


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("node", ["simulator", "controller", "trajectory"])
def test_a_signal_ends_a_started_node_cleanly(bench: Bench, node: str, number: signal.Signals) -> None:
    process = bench.start(node)

    def is_started() -> bool:
        label = bench.call(GetState, f"{node}/get_state", GetState.Request()).current_state.label
        # A controller becomes active with the first joint state.
        return bool(label == ("inactive" if node == "controller" else "active"))

    bench.spin_until(is_started, f"{node} has started")
    process.process.send_signal(number)
    assert process.wait() == 0
    assert "Traceback" not in process.log.read_text()


@pytest.mark.parametrize("node", ["simulator", "controller", "trajectory", "recorder"])
def test_a_signal_while_starting_ends_a_node_cleanly(bench: Bench, node: str) -> None:
    process = bench.start(node, *([f"output:={bench.folder / 'bag'}"] if node == "recorder" else []))
    # Somewhere on its way up: as soon as others can see it.
    bench.spin_until(lambda: node in bench.node.get_node_names(), f"{node} appears")
    process.interrupt()
    assert process.wait() == 0
    assert "Traceback" not in process.log.read_text()


def test_recorder_says_why_it_cannot_write(bench: Bench) -> None:
    occupied = bench.folder / "bag"
    occupied.mkdir()
    process = bench.start("recorder", f"output:={occupied}")
    assert process.wait() == 1
    lines = process.log.read_text().splitlines()
    assert len(lines) == 1
    assert "cannot record" in lines[0]
    assert str(occupied) in lines[0]
