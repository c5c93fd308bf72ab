"""Handling of SIGINT and SIGTERM."""

import os
import signal
from types import FrameType


class Stop:
    """Ends the process at once during its imports; later it sets a flag that the loop checks.

    Create it before the imports, which take half a second, so that Ctrl-C meanwhile is not an error.

    Attributes:
        requested: whether one of the signals was received.
    """

    def __init__(self) -> None:
        self.requested = False
        self._deferred = False
        signal.signal(signal.SIGINT, self._request)
        signal.signal(signal.SIGTERM, self._request)

    def defer(self) -> None:
        """From now on, only set the flag: the process must end at a safe point."""
        self._deferred = True

    def finish(self) -> None:
        """Ignore signals from now on: the process ends anyway, and a late signal must not change its exit code."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)

    def _request(self, _signal: int, _frame: FrameType | None) -> None:
        if not self._deferred:
            os._exit(0)
        self.requested = True
