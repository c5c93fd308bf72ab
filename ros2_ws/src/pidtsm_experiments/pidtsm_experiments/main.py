"""Entry point of ``ros2 run``, in a file of its own: signals are taken before the imports, see `Stop`."""

import sys

from pidtsm_ros.stop import Stop


def recorder() -> None:
    """``ros2 run pidtsm_experiments recorder``; exit code 1: an incomplete bag, 2: bad parameters."""
    stop = Stop()
    from pidtsm_experiments.recorder import run

    sys.exit(run(stop))
