"""Entry point of every executable. It handles signals before the imports, which take half a second; see `Stop`."""

import sys
from importlib.metadata import entry_points
from pathlib import Path

from pidtsm_ros.leaving import leave_within
from pidtsm_ros.stop import Stop

GROUP = "pidtsm_ros.executables"
"""Entry point group of executables, in a package's setup.py: NAME = MODULE:FUNCTION; the function gets a `Stop` and
returns the exit code."""


def main() -> None:
    """Run the executable whose name this process was started with."""
    stop = Stop()
    (executable,) = entry_points(group=GROUP, name=Path(sys.argv[0]).name)
    code = executable.load()(stop)
    leave_within(code)
    sys.exit(code)
