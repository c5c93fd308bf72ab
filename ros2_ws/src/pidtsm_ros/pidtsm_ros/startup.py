"""How every process of ours starts: it says in one line why it cannot, and notes when it is to end."""

import signal
import sys
from collections.abc import Sequence
from types import FrameType
from typing import NoReturn

import rclpy
from rclpy.signals import SignalHandlerOptions

from pidtsm_ros.security import guarded


class Stop:
    """Set by SIGINT and SIGTERM, so that the loop ends where it is safe to.

    Attributes:
        requested: one of them has come.
    """

    def __init__(self) -> None:
        self.requested = False
        signal.signal(signal.SIGINT, self._request)
        signal.signal(signal.SIGTERM, self._request)

    def _request(self, number: int, frame: FrameType | None) -> None:
        self.requested = True


def start_ros(args: Sequence[str] | None = None) -> Stop:
    """Initialise ROS, and take its signals over.

    Args:
        args: command line; the process's own where None.

    Raises:
        SystemExit: ROS cannot start so, see `refuse`.
    """
    stop = Stop()
    try:
        rclpy.init(args=guarded(args), signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        refuse(error)
    return stop


def refuse(error: Exception) -> NoReturn:
    """End the process, which cannot start: one line on standard error, exit code 2.

    Raises:
        SystemExit: always.
    """
    print(f"cannot start: {' '.join(str(error).split())}", file=sys.stderr)
    sys.exit(2)
