"""A process that should end does so, whatever hangs in it."""

import subprocess
import sys

import pytest

# Held by a call that does not release Python's lock, neither threads nor signal handlers of Python run.
_HANGS = "ctypes.PyDLL(None).sleep(60)"
_PROGRAM = """
import ctypes, signal, sys
from pidtsm_ros.leaving import {function}
signal.signal(signal.SIGTERM, signal.SIG_IGN)
{block}
"""


def run(function: str, block: str) -> subprocess.CompletedProcess[str]:
    program = _PROGRAM.format(function=function, block=block)
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=50.0)


@pytest.mark.parametrize("code", [0, 1, 2])
def test_a_process_that_hangs_at_its_end_leaves_and_reports_it(code: int) -> None:
    ended = run("leaving_within", f"with leaving_within({code}, 0.2): {_HANGS}")
    assert ended.returncode == code
    (line,) = ended.stderr.splitlines()
    assert "the middleware did not end within 0.2 s" in line


def test_a_process_that_hangs_after_its_last_line_leaves() -> None:
    block = f"import atexit; atexit.register(lambda: {_HANGS}); leave_within(1, 0.2); sys.exit(1)"
    assert run("leave_within", block).returncode == 1


def test_a_process_that_ends_in_time_is_not_disturbed() -> None:
    block = "with leaving_within(7, 0.2): pass\nimport time; time.sleep(0.5)"
    ended = run("leaving_within", block)
    assert (ended.returncode, ended.stderr) == (0, "")
