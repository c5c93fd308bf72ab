"""Entry points of ``ros2 run``, in a file of their own: signals are taken before the imports, see `Stop`."""

import sys

from pidtsm_ros.stop import Stop


def simulator() -> None:
    """``ros2 run two_link_sim simulator``."""
    stop = Stop()
    from pidtsm_ros.process import run
    from two_link_sim.simulator import Simulator

    sys.exit(run([Simulator], stop))


def visualization() -> None:
    """``ros2 run two_link_sim visualization``; exit code 2: bad parameters."""
    stop = Stop()
    from two_link_sim.visualization import run

    run(stop)
