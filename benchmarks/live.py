"""The loop at 1 kHz with two pages open beside none, and the memory of the page."""

import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil

from pidtsm_experiments.commands.bench import Row

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))

from support.devtools import browser  # In the folder of the tests, as the next two.
from support.liveclient import live_client
from support.livepage import LiveSystem, live_process, until

TAKES = 150.0  # s
_TURNS, _LASTS, _SETTLES = 5, 12.0, 2.0
_PAGES = 2
_MEGABYTE = 1e6
_HOUR = 3600.0  # s
_FIRST = 600.0
"""The memory grows while the curves fill and the interpreter settles; it counts after this time, s."""


class _Loop(NamedTuple):
    """What a controller reported while it was watched: age of the joint states, s, and missed deadlines."""

    ages: list[float]
    missed: int


def run(quick: bool) -> Iterator[Row]:
    """In turns: the loop without pages and with two, each a connection that takes all that a browser takes."""
    turns, lasts = (2, 3.0) if quick else (_TURNS, _LASTS)
    found: dict[int, list[_Loop]] = {0: [], _PAGES: []}
    with tempfile.TemporaryDirectory() as name, live_process(Path(name)) as system:
        with live_client(system.address) as first:
            until(lambda: "Following" in first.shown('id="status"'), "the arm follows")
        for _ in range(turns):
            for pages, loops in found.items():
                loops.append(_watch(system, pages, lasts))
    alone, beside = (found[pages] for pages in (0, _PAGES))
    p50 = [float(np.median([age for loop in loops for age in loop.ages])) for loops in (alone, beside)]
    missed = [float(sum(loop.missed for loop in loops)) for loops in (alone, beside)]
    yield Row(
        "age of a joint state when it is answered, two pages", p50[1] * 1e6, "us", "no page", p50[0] * 1e6,
        p50[1] / p50[0], "<= 1.05",
    )  # fmt: skip
    yield Row(
        "missed deadlines, two pages", missed[1], "", "no page", missed[0], missed[1] / max(missed[0], 1.0), "<= 1.5"
    )


def _watch(system: LiveSystem, pages: int, lasts: float) -> _Loop:
    """The loop while this many pages are open, as a node that joins the domain receives it from the controller."""
    with ExitStack() as stack:
        for _ in range(pages):
            stack.enter_context(live_client(system.address))
        time.sleep(_SETTLES)
        return _states(system, lasts)


def _states(system: LiveSystem, lasts: float) -> _Loop:
    import rclpy
    from rclpy.node import Node

    from pidtsm_experiments.live.stream import StateStream

    context = rclpy.Context()
    rclpy.init(context=context, domain_id=system.domain)
    node = Node("bench", namespace="/live", context=context)
    stream, ages, missed = StateStream(node), [], []
    end = time.monotonic() + lasts
    while time.monotonic() < end:
        time.sleep(0.02)
        if (batch := stream.take()) is not None:
            ages.append(float(batch.newest.state_age))
            missed.append(int(batch.newest.missed_deadlines))
    node.destroy_node()
    context.try_shutdown()
    return _Loop(ages, missed[-1] - missed[0])


class _Memory(NamedTuple):
    """What is in use: by the process of the page, by its tab's scripts, and by all of the browser, MB."""

    server: float
    scripts: float
    browser: float


def memory(minutes: float) -> Iterator[tuple[float, _Memory]]:
    """Time (s) and memory, once a minute, while a browser shows the page."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        system = stack.enter_context(live_process(folder))
        server = next(p for p in psutil.Process().children() if "live" in p.cmdline())
        page = stack.enter_context(browser(folder / "profile", in_3d=True))
        chromium = next(p for p in psutil.Process().children() if "--headless" in p.cmdline())
        page.open(system.address)
        page.wait("document.querySelector('[role=tab]') !== null")
        began = time.monotonic()
        while (passed := time.monotonic() - began) < minutes * 60.0:
            page.call("HeapProfiler.collectGarbage")
            page.events.clear()
            processes = [chromium, *chromium.children(recursive=True)]
            yield (
                passed,
                _Memory(
                    server.memory_full_info().uss / _MEGABYTE,
                    page.call("Runtime.getHeapUsage")["usedSize"] / _MEGABYTE,
                    sum(p.memory_full_info().uss for p in processes) / _MEGABYTE,
                ),
            )
            time.sleep(min(60.0, minutes * 6.0))


def _growth(found: list[tuple[float, _Memory]]) -> _Memory:
    """MB in an hour, after the first minutes."""
    late = [(passed, *used) for passed, used in found if passed >= _FIRST]
    times, *columns = np.transpose(late)
    return _Memory(*(float(np.polyfit(times / _HOUR, column, 1)[0]) for column in columns))


if __name__ == "__main__":
    found = []
    for passed, used in memory(float(sys.argv[1])):
        found.append((passed, used))
        print(f"{passed:.0f} s, MB: " + ", ".join(f"{k} {v:.1f}" for k, v in used._asdict().items()), flush=True)
    if found[-1][0] > _FIRST:
        growth = _growth(found)._asdict().items()
        print(f"after {_FIRST:.0f} s, MB in an hour: " + ", ".join(f"{k} {v:.1f}" for k, v in growth))
