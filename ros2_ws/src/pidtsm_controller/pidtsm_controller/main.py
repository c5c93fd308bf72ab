"""Entry points of ``ros2 run``, in a file of their own: signals are taken before the imports, see `Stop`."""

import sys

from pidtsm_ros.stop import Stop


def controller() -> None:
    """``ros2 run pidtsm_controller controller``."""
    stop = Stop()
    from pidtsm_controller.controller import ControllerNode
    from pidtsm_ros.process import run

    sys.exit(run([ControllerNode], stop))


def trajectory() -> None:
    """``ros2 run pidtsm_controller trajectory``."""
    stop = Stop()
    from pidtsm_controller.trajectory import Trajectory
    from pidtsm_ros.process import run

    sys.exit(run([Trajectory], stop))
