"""Samples properties of running node processes."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

from pidtsm_experiments.runs.runner import EXECUTABLES

FLOOR_NODES = Path(__file__).with_name("floor_nodes.py")

Looks = list[tuple[float, float]]
"""Time (s) and value of each sample."""


@contextmanager
def watched(look: Callable[[psutil.Process], float], every: float) -> Iterator[dict[str, Looks]]:
    """Sample the node processes started by this process, every `every` s until the end of the block.

    Yields the samples by node name.
    """
    seen: dict[str, Looks] = {}
    stop = threading.Event()

    def watch() -> None:
        while not stop.wait(every):
            for process in psutil.Process().children():
                with suppress(psutil.NoSuchProcess):
                    if name := _node(process.cmdline()):
                        seen.setdefault(name, []).append((time.monotonic(), look(process)))

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield seen
    finally:
        stop.set()
        thread.join()


def _node(command: list[str]) -> str | None:
    programs = [Path(word).name for word in command[:2]]
    if FLOOR_NODES.name in programs:
        return command[2]
    return next((program for program in programs if program in EXECUTABLES), None)
