"""Records a running system from the command line."""

import asyncio
import math
import time
from pathlib import Path
from typing import NamedTuple

from rich.live import Live
from rich.text import Text

from pidtsm_core.errors import UsageError
from pidtsm_experiments.commands.options import CONSOLE
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.live.recording import Recording
from pidtsm_experiments.live.system import System
from pidtsm_experiments.operate.attached import found
from pidtsm_ros.stop import Stop

_PERIOD = 0.1  # s
_SCENARIO = "live"
_FIRST_WITHIN = 60.0
"""s to the first sample; a recording of some seconds lasts so long from then on, or from the first sample."""


class Kept(NamedTuple):
    """What was recorded.

    Attributes:
        bag: its folder.
        samples: number of them.
        size: of the bag, bytes.
    """

    bag: Path
    samples: int
    size: int


async def record(system: System, output: Path | None, duration: float | None) -> Kept:
    """Record until SIGINT or SIGTERM, or for a time; then finish the bag.

    Args:
        system: what is recorded.
        output: new folder of the bag; None: one with the time in its name.
        duration: s from the first sample; None: without end.

    Raises:
        UsageError: the folder exists.
        RunError: there is no controller, or the recorder has ended by itself.
        RefusedError: a node does not answer, or the bag is incomplete.
    """
    bag = output or Path(f"bag-{time.strftime('%Y-%m-%d-%H-%M-%S')}")
    if bag.exists():
        raise UsageError(f"--output {bag}: exists; name a new folder")
    await found(system, "controller")
    nodes = ["controller", *(["trajectory"] if system.has("trajectory") else [])]
    values = {node: {each.name: each.value for each in await system.described(node)} for node in nodes}
    stop = Stop()
    stop.defer()
    recording = Recording(bag.absolute().parent, system.namespace)
    try:
        recording.start(_SCENARIO, values, bag.absolute())
        begin = time.monotonic() + _FIRST_WITHIN
        with Live(console=CONSOLE, transient=True, auto_refresh=False) as line:
            while recording.on and not stop.requested and time.monotonic() < begin + (duration or math.inf):
                if recording.samples:
                    begin = min(begin, time.monotonic())
                line.update(Text(f"recording to {bag}: {recording.text}; Ctrl-C ends it"), refresh=True)
                await asyncio.sleep(_PERIOD)
        if recording.ended:
            raise RunError(f"the bag {bag} is incomplete, because {recording.incomplete}")
        await recording.stop()
    finally:
        recording.close()
    return Kept(bag, recording.samples, recording.size)
