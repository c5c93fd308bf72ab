"""A live page as a person uses it: ``./pidtsm live`` as a process, and a browser that presses its buttons."""

import json
import os
import re
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil
import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from pidtsm_core.arrays import Array
from pidtsm_ros.middleware import on_this_machine
from support.devtools import Page
from support.nursery import forked_command

DEADLINE = 180.0
"""s; only a failing test waits that long, or one whose nodes compile on a busy machine."""
RATE = 250
"""Hz; a quarter of the usual, as the nodes run for as long as the tests wait."""
_VISIBLE = "e => e.offsetParent !== null"
_SHARED = """
const visible = (selector, text) => [...document.querySelectorAll(selector)]
    .filter(e => e.offsetParent !== null && e.textContent.trim() === text);
const mark = element => {
    document.querySelectorAll('[data-marked]').forEach(e => e.removeAttribute('data-marked'));
    element.setAttribute('data-marked', '');
    return true;
};
"""
MARKED = "[data-marked]"


def until(condition: Callable[[], Any], what: str | Callable[[], str]) -> Any:
    """Wait for a condition, and return what it returned."""
    end = time.monotonic() + DEADLINE
    while not (found := condition()):
        if time.monotonic() > end:
            pytest.fail(f"not within {DEADLINE:g} s: {what if isinstance(what, str) else what()}")
        time.sleep(0.05)
    return found


def free_port() -> int:
    """A port that nobody uses now."""
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        return int(held.getsockname()[1])


class LiveSystem(NamedTuple):
    """A running ``./pidtsm live``; `process`: its number."""

    address: str
    folder: Path
    domain: int
    process: int

    def kill(self, node: str) -> None:
        """End the process of a node at once; unknown to the page."""

        def found() -> list[psutil.Process]:
            children = psutil.Process(self.process).children(recursive=True)
            # Forked ones have a name, those of the page itself the path of their executable.
            return [c for c in children if node in (c.name(), *(Path(word).name for word in c.cmdline()))]

        until(found, f"the process of {node}")[0].kill()


def parameter(system: LiveSystem, name: str) -> Any:
    """The value of a parameter of the running controller, read by a node of the test's; a list as a tuple."""
    with pytest.MonkeyPatch.context() as patch:
        for variable, value in on_this_machine(os.environ).items():
            patch.setenv(variable, value)
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=system.domain)
        node = Node("stranger", context=context)
        executor = rclpy.executors.SingleThreadedExecutor(context=context)
        try:
            client = AsyncParameterClient(node, "/live/controller")
            assert client.wait_for_services(DEADLINE)
            future = client.get_parameters([name])
            rclpy.spin_until_future_complete(node, future, executor, DEADLINE)
            found = parameter_value_to_python(future.result().values[0])
            return tuple(found) if hasattr(found, "__iter__") and not isinstance(found, str) else found
        finally:
            executor.shutdown()
            node.destroy_node()
            context.try_shutdown()


class LivePage:
    """A browser's view of the page: its controls are found by their texts."""

    def __init__(self, page: Page, system: LiveSystem) -> None:
        """Open the page, and wait until it shows the system."""
        self.page, self.system = page, system
        page.open(system.address, 1000, 500)
        page.wait("document.querySelector('[role=tab]') !== null")

    def until(self, condition: Callable[[], Any], what: str) -> Any:
        """Wait for a condition, and return what it returned; a failure tells what the page showed."""
        return until(condition, lambda: f"{what}; the page: {self.text('#status')}; {self.text('#events')}")

    def _mark(self, script: str) -> None:
        self.page.wait(f"(() => {{ {_SHARED} {script} }})()")

    def press(self, label: str) -> None:
        """Press a button, or open a tab, with the keyboard: lines that appear above move them away from a mouse."""
        shown = f"visible('button, [role=tab]', {json.dumps(label)})"
        self._mark(f"const [found] = {shown}; return found ? mark(found) : false;")
        self.page.focus(MARKED)
        self.page.key("Enter", 13, "\r")

    def _click(self) -> None:
        """Click on what is marked, wherever it is by now."""
        self.page.evaluate(f"document.querySelector('{MARKED}').click()")

    def field(self, label: str) -> None:
        """Mark the field with this label."""
        self._mark(
            f"""const [found] = visible('label', {json.dumps(label)});
            let around = found;
            while (around && !around.querySelector('input')) around = around.parentElement;
            return around ? mark(around.querySelector('input')) : false;"""
        )

    def value(self, label: str) -> str:
        """What a field shows."""
        self.field(label)
        return str(self.page.evaluate(f"document.querySelector('{MARKED}').value"))

    def flip(self, label: str, on: bool) -> None:
        """Click on a check box until it is, or is not, checked; a system that is busy may show it late."""
        checked = f"document.querySelector('{MARKED}').checked"

        def flipped() -> bool:
            self.field(label)
            if self.page.evaluate(checked) is not on:
                self._click()
            return self.page.evaluate(checked) is on

        until(flipped, f"{label} is {'on' if on else 'off'}")

    def checked(self, label: str) -> bool:
        """Whether a check box is checked."""
        self.field(label)
        return bool(self.page.evaluate(f"document.querySelector('{MARKED}').checked"))

    def enter(self, label: str, value: str) -> None:
        """Write into a field, and press Enter."""
        self.field(label)
        self.page.focus(MARKED)
        self.page.evaluate(f"document.querySelector('{MARKED}').select()")
        self.page.call("Input.insertText", text=value)
        until(lambda: self.value(label) == value, f"{label} shows {value}")
        self.page.key("Enter", 13, "\r")

    def step(self, label: str) -> None:
        """Move a slider by one step to the right, with the keyboard."""
        self._mark(
            f"""const [found] = visible('label', {json.dumps(label)});
            let around = found;
            while (around && !around.querySelector('[role=slider]')) around = around.parentElement;
            return around ? mark(around.querySelector('[role=slider]')) : false;"""
        )
        self.page.focus(MARKED)
        self.page.key("ArrowRight", 39)

    def choose(self, label: str, value: str) -> None:
        """Choose a value of a list."""
        self.field(label)
        self._click()
        self._mark(f"const [one] = visible('[role=option]', {json.dumps(value)}); return one ? mark(one) : false;")
        self._click()

    def text(self, selector: str) -> str:
        """The text of an element; empty if there is none."""
        return str(self.page.evaluate(f"document.querySelector({selector!r})?.textContent ?? ''"))

    def notification(self) -> str:
        """What became of the last values, in the open tab."""
        script = f"[...document.querySelectorAll('[role=status]')].filter({_VISIBLE}).map(e => e.textContent).join()"
        return str(self.page.evaluate(script))

    def curve(self, title: str) -> Array:
        """The curves of a plot: time, one row per joint, and the line of the events, shape (2 + joints, points)."""
        script = f"""Object.values(window.__viserTestpoints?.uplots ?? {{}}).map(plot => plot.chart)
            .filter(chart => chart.root.textContent.includes({title!r}))
            .map(chart => chart.data.map(row => [...row]))[0]"""
        return np.array(until(lambda: self.page.evaluate(script), title))

    def spikes(self) -> list[float]:
        """When something happened, as the plot of the error shows it, s before now."""
        time, *errors, events = self.curve("error e")
        return [float(t) for t in time[events > np.max(errors)]]

    def worst_error(self, seconds: float) -> float:
        """Largest error of any joint in the last seconds, as the plot shows it, mrad; nan: it shows none of then."""
        time, *errors, _ = self.curve("error e")
        shown = np.abs(np.array(errors)[:, time >= -seconds])
        return float(shown.max()) if shown.size else float("nan")


@contextmanager
def live_process(folder: Path, *options: str) -> Iterator[LiveSystem]:
    """``./pidtsm live`` in a folder."""
    log = folder / "live.log"
    words = ["live", "--port", str(free_port()), "--set", f"simulator.rate={RATE}", *options]
    process = forked_command(words, folder, os.environ, log)
    try:

        def address() -> Any:
            assert process.poll() is None, log.read_text()
            return re.search(r"live page: (\S+)", log.read_text())

        found = until(address, "the address of the page")
        domain = re.search(r"ROS_DOMAIN_ID=(\d+)", log.read_text())
        assert domain
        yield LiveSystem(found[1], folder, int(domain[1]), process.pid)
    finally:
        process.send_signal(signal.SIGINT)
        code = process.wait(DEADLINE)
    assert code == 0, log.read_text()
    assert "Traceback" not in log.read_text(), log.read_text()
