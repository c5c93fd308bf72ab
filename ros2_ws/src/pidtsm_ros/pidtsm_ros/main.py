"""The entry point of every executable: signals are taken before the imports, which take half a second, see `Stop`."""

import sys
from importlib.metadata import entry_points
from pathlib import Path

from pidtsm_ros.stop import Stop

GROUP = "pidtsm_ros.executables"
"""Entry points of this group, in a package's setup.py: NAME = MODULE:FUNCTION, from a `Stop` to the exit code."""


def main() -> None:
    """Run the executable that this process is started as."""
    stop = Stop()
    (executable,) = entry_points(group=GROUP, name=Path(sys.argv[0]).name)
    sys.exit(executable.load()(stop))
