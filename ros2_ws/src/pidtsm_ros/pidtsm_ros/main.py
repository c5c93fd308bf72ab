"""Entry point of ``ros2 run``, in a file of its own: signals are taken before the imports, see `Stop`."""

import sys

from pidtsm_ros.stop import Stop


def composed() -> None:
    """``ros2 run pidtsm_ros composed``."""
    stop = Stop()
    from pidtsm_ros.composed import run_chosen

    sys.exit(run_chosen(stop))
