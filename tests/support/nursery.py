"""Our nodes as processes that are forked from one which has imported and compiled everything: a start takes 0.2 s.

What runs is the entry point of the executable, in a process of its own, with the environment, the arguments and the
output of one that was started by ``ros2 run``; only Python's start and the imports are saved, 1.5 s of processor each.
"""

import ctypes
import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any
from unittest.mock import patch

from pidtsm_experiments.runs.runner import Process

_NURSERY = multiprocessing.get_context("forkserver")
_NURSERY.set_forkserver_preload(["support.nursery_preload"])
_PR_SET_PDEATHSIG = 1
_FOLDER = str(Path(__file__).parents[1])


def _context() -> Any:
    """How to fork: a process that was forked itself has imported everything already, see `forked_runs`."""
    return _NURSERY if multiprocessing.parent_process() is None else multiprocessing.get_context("fork")


class NurseryProcess(Process):
    """One node's process, forked; see `Process`."""

    def __init__(self, name: str, arguments: Sequence[str], environment: Mapping[str, str], log: Path) -> None:
        self.name, self.log = name, log
        log.touch()
        words = [name, "--ros-args", *arguments]
        context = _context()
        reader, writer = context.Pipe(duplex=False) if name == "recorder" else (None, None)
        process = context.Process(target=_become, args=(words, dict(environment), log, writer))
        self.process = _Popen(process, reader)  # type: ignore[assignment]
        for end in filter(None, (reader, writer)):
            end.close()


class _Popen:
    """A forked process with what is used of `subprocess.Popen`."""

    def __init__(self, process: Any, stdout: Connection | None) -> None:
        self._process = process
        self.stdout = os.fdopen(os.dup(stdout.fileno()), "rb") if stdout else None
        # So that the process that forks, which the first call starts, finds the modules beside this one.
        with patch.dict(os.environ, PYTHONPATH=os.pathsep.join([_FOLDER, os.environ.get("PYTHONPATH", "")])):
            process.start()
        self.pid: int = process.pid

    @property
    def returncode(self) -> int | None:
        return self.poll()

    def poll(self) -> int | None:
        code: int | None = self._process.exitcode
        return code

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        code = self.poll()
        if code is None:
            raise subprocess.TimeoutExpired(self._process.name, timeout or 0.0)
        return code

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)


def _become(words: list[str], environment: dict[str, str], log: Path, stdout: Connection | None) -> None:
    """Run the executable `words[0]` in this process, its output in the log, but for that given to `stdout`."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    os.setsid()
    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for old, new in ((nothing, 0), (stdout.fileno() if stdout else output, 1), (output, 2)):
        os.dup2(old, new)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv[:] = words
    from pidtsm_ros.main import main

    main()
