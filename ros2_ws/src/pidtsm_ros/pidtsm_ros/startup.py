"""How every process of ours starts, or says in one line why it cannot."""

import sys
from collections.abc import Sequence
from typing import NoReturn

import rclpy
from rclpy.signals import SignalHandlerOptions

from pidtsm_ros.security import prepare_process
from pidtsm_ros.stop import Stop


def start_ros(stop: Stop, args: Sequence[str] | None = None) -> None:
    """Initialise ROS, but for its signals.

    Args:
        stop: takes the signals, and is deferred from now on.
        args: command line; the process's own where None.

    Raises:
        SystemExit: ROS cannot start so, see `refuse`.
    """
    stop.defer()
    try:
        rclpy.init(args=prepare_process(args), signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        refuse(error)


def refuse(error: Exception) -> NoReturn:
    """End the process, which cannot start: one line on standard error, exit code 2.

    Raises:
        SystemExit: always.
    """
    print(f"cannot start: {' '.join(str(error).split())}", file=sys.stderr)
    sys.exit(2)
