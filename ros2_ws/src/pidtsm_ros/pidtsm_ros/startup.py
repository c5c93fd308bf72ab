"""Startup of every process; if it fails, the reason is printed in one line."""

import sys
from collections.abc import Sequence
from typing import NoReturn

import rclpy
from rclpy.signals import SignalHandlerOptions

from pidtsm_ros.security import prepare_process
from pidtsm_ros.stop import Stop

INVALID = 2
"""Exit code of a process that cannot start."""


def start_ros(stop: Stop, args: Sequence[str] | None = None) -> None:
    """Initialise ROS without its signal handlers.

    Args:
        stop: handles the signals; deferred from now on.
        args: command line; None: that of the process.

    Raises:
        SystemExit: ROS cannot start, see `refuse`.
    """
    stop.defer()
    try:
        rclpy.init(args=prepare_process(args), signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        refuse(error)


def refuse(error: Exception) -> NoReturn:
    """End a process that cannot start: print one line on standard error, exit with code `INVALID`.

    Raises:
        SystemExit: always.
    """
    print(f"cannot start: {' '.join(str(error).split())}", file=sys.stderr)
    sys.exit(INVALID)
