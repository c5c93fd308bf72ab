"""Our nodes and commands as processes that are forked from one which has imported everything: a start takes 0.2 s.

What runs is the entry point of the executable, in a process of its own, with the environment, the arguments and the
output of one that was started by ``ros2 run`` or ``./pidtsm``; only Python's start and the imports are saved, 1.5 s of
processor each.
"""

import ctypes
import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any
from unittest.mock import patch

from pidtsm_experiments.runs import runner
from pidtsm_experiments.runs.runner import Process

_NURSERY = multiprocessing.get_context("forkserver")
_PRELOADED = ["support.forked_runs"]
_NURSERY.set_forkserver_preload(_PRELOADED)
_PR_SET_PDEATHSIG, _PR_SET_NAME = 1, 15
_FOLDER = str(Path(__file__).parents[1])


def _context() -> Any:
    """How to fork: a process that was forked itself has imported everything already, see `forked_runs`."""
    return _NURSERY if multiprocessing.parent_process() is None else multiprocessing.get_context("fork")


def begin() -> None:
    """Start the process that forks, unless it runs: who starts it decides for all tests what it has imported.

    A reproduction in the process of a test forks its runs from it, too, and would start one without the nodes.
    """
    _NURSERY.set_forkserver_preload(_PRELOADED)
    # So that the process finds the modules beside this one.
    with patch.dict(os.environ, PYTHONPATH=os.pathsep.join([_FOLDER, os.environ.get("PYTHONPATH", "")])):
        forkserver.ensure_running()


class NurseryProcess(Process):
    """One node's process, forked; see `Process`."""

    context = staticmethod(_context)

    def __init__(self, name: str, arguments: Sequence[str], environment: Mapping[str, str], log: Path) -> None:
        self.name, self.log = name, log
        log.touch()
        words = [name, "--ros-args", *arguments]
        context = self.context()
        reader, writer = context.Pipe(duplex=False) if name == "recorder" else (None, None)
        process = context.Process(target=_become, args=(words, dict(environment), log, writer))
        self.process = _Popen(process, reader)  # type: ignore[assignment]
        for end in filter(None, (reader, writer)):
            end.close()


class _ProcessOfACommand(NurseryProcess):
    """Likewise, but of a command that has joined ROS, which its nodes must not inherit: it has a nursery of its own."""

    context = staticmethod(lambda: _NURSERY)


class _Popen:
    """A forked process with what is used of `subprocess.Popen`."""

    def __init__(self, process: Any, stdout: Connection | None) -> None:
        self._process = process
        self.stdout = os.fdopen(os.dup(stdout.fileno()), "rb") if stdout else None
        if multiprocessing.parent_process() is None:
            begin()
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


def forked_command(words: Sequence[str], folder: Path, environment: Mapping[str, str], log: Path) -> "_Popen":
    """``./pidtsm`` with these words, started in a folder; it forks its nodes, too. Its output is in the log."""
    log.touch()
    return _Popen(_context().Process(target=_command, args=(list(words), str(folder), dict(environment), log)), None)


def _command(words: list[str], folder: str, environment: dict[str, str], log: Path) -> None:
    """Run the command in this process."""
    _settle(environment, log, None)
    os.chdir(folder)
    runner.Process = _ProcessOfACommand  # type: ignore[misc]
    from pidtsm_experiments.cli import main

    sys.exit(main(words))


def _become(words: list[str], environment: dict[str, str], log: Path, stdout: Connection | None) -> None:
    """Run the executable `words[0]` in this process, its output in the log, but for that given to `stdout`."""
    _settle(environment, log, stdout)
    sys.argv[:] = words
    ctypes.CDLL(None).prctl(_PR_SET_NAME, words[0].encode())  # By which tests find it.
    from pidtsm_ros.main import main

    main()


def _settle(environment: dict[str, str], log: Path, stdout: Connection | None) -> None:
    """Make this process one that was started with this environment and output, and ends with what started it."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    os.setsid()
    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for old, new in ((nothing, 0), (stdout.fileno() if stdout else output, 1), (output, 2)):
        os.dup2(old, new)
    os.environ.clear()
    os.environ.update(environment)
