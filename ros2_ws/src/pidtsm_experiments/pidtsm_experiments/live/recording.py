"""Recording of a running system: the recorder as a process, started and ended from the page."""

import asyncio
import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_core.parameters import Value
from pidtsm_core.parameters.files import ros_parameters
from pidtsm_experiments.errors import RunError
from pidtsm_experiments.live.errors import RefusedError
from pidtsm_experiments.runs.files import write_file
from pidtsm_experiments.runs.origin import comment
from pidtsm_experiments.runs.runner import Process, Processes, how_ended, robot_metadata


class Recording:
    """At most one recorder at a time.

    Attributes:
        bag: folder of the bag that is written, or was written last; None: there is none.
    """

    def __init__(self, folder: Path, namespace: str, surroundings: Mapping[str, str] | None = None) -> None:
        """Prepare it.

        Args:
            folder: for the bags and the logs.
            namespace: of the system, beginning with a slash.
            surroundings: environment variables of the recorder; None: those of this process.
        """
        self.bag: Path | None = None
        self._samples = 0
        self._lost = ""
        self._folder, self._namespace = folder, namespace
        self._environment = {**os.environ, **(surroundings or {})}
        self._processes = Processes()

    @property
    def samples(self) -> int:
        """Number of samples in the bag so far."""
        process = self._processes.running.get("recorder")
        # Also to empty the pipe: a recorder whose output nobody reads would stop.
        if process is not None and process.process.stdout is not None:
            os.set_blocking(process.process.stdout.fileno(), False)
            for line in (process.process.stdout.read() or b"").decode().splitlines():
                if line.startswith("recorded "):
                    self._samples = int(line.split()[1])
        return self._samples

    @property
    def on(self) -> bool:
        """Whether a recorder runs."""
        process = self._processes.running.get("recorder")
        return process is not None and process.process.poll() is None

    @property
    def ended(self) -> str:
        """How the recorder has ended by itself; empty: it runs, or was not started to record."""
        process = self._processes.running.get("recorder")
        code = None if process is None else process.process.poll()
        return "" if code is None else how_ended(code)

    @property
    def incomplete(self) -> str:
        """Why the bag that was written last lacks its end; empty: it does not."""
        return self._lost or (self.ended and f"the recorder {self.ended}")

    @property
    def size(self) -> int:
        """Size of the bag so far, bytes."""
        files = () if self.bag is None else tuple(self.bag.glob("*"))
        return sum(file.stat().st_size for file in files)

    @property
    def text(self) -> str:
        """How much has been recorded so far."""
        return f"{self.samples} samples, {self.size / 1e6:.1f} MB"

    def start(self, scenario: str, values: Mapping[str, Mapping[str, Value]], bag: Path | None = None) -> Path:
        """Begin a bag; returns its folder.

        Args:
            scenario: its name, for the report.
            values: parameters of the controller, and of the trajectory node if there is one, by node.
            bag: new folder; None: one in the folder of the recordings, with the time in its name.

        Raises:
            RefusedError: a recorder runs, or cannot be started.
        """
        if self.on:
            raise RefusedError(f"recording already, to {self.bag}")
        controller = values["controller"]
        known: dict[str, Any] = {"scenario": scenario, "law": controller["law.name"], "clock": "realtime"}
        known |= {"namespace": self._namespace.strip("/")} if self._namespace != "/" else {}
        known |= {"trajectory": dict(values["trajectory"])} if "trajectory" in values else {}
        try:
            metadata = json.dumps(known | robot_metadata(controller))
            self._folder.mkdir(parents=True, exist_ok=True)
            bag = bag or self._folder / f"bag-{time.strftime('%Y-%m-%d-%H-%M-%S')}"
            file = bag.with_name(f"{bag.name}.yaml")
            nodes = {"recorder": {"metadata": metadata, "output": str(bag)}, **values}
            write_file(file, comment() + "".join(ros_parameters(node, given) for node, given in nodes.items()))
            words = ["--params-file", str(file), "-p", "plain_names:=true", "-r", f"__ns:={self._namespace}"]
            self._processes.running.pop("recorder", None)
            self._processes.start("recorder", words, self._environment, bag.with_name(f"{bag.name}.log"))
        except (OSError, RunError, UsageError) as error:
            raise RefusedError(f"cannot record: {error}") from None
        self.bag, self._samples, self._lost = bag, 0, ""
        return bag

    async def stop(self) -> Path:
        """End the bag; returns its folder.

        Raises:
            RefusedError: no recorder runs, or the bag is incomplete.
        """
        process = self._processes.running.get("recorder")
        if process is None or self.bag is None:
            raise RefusedError("nothing is being recorded")
        process.interrupt()
        code = await asyncio.to_thread(process.wait)
        self._samples = self.samples  # The last line that it has printed.
        self._processes.running.pop("recorder", None)
        if code:
            self._lost = f"the recorder {how_ended(code)}"
            raise RefusedError(f"the bag {self.bag} is incomplete: {_last_line(process)}")
        return self.bag

    def close(self) -> None:
        """End the recorder, if it runs."""
        self._processes.__exit__(None, None, None)


def _last_line(process: Process) -> str:
    return process.tail().splitlines()[-1].strip()
