"""What SIGINT and SIGTERM do to a process of ours."""

import os
import signal
from types import FrameType


class Stop:
    """Ends the process at once while it only imports; afterwards notes that it is to end, for the loop to look at.

    It comes before the imports, which take half a second: a Ctrl-C meanwhile is no error.

    Attributes:
        requested: one of the signals has come.
    """

    def __init__(self) -> None:
        self.requested = False
        self._deferred = False
        signal.signal(signal.SIGINT, self._request)
        signal.signal(signal.SIGTERM, self._request)

    def defer(self) -> None:
        """From now on the process must end where it is safe to."""
        self._deferred = True

    def finish(self) -> None:
        """The process ends anyway: a signal that comes while Python tears itself down must not change its exit code."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)

    def _request(self, _signal: int, _frame: FrameType | None) -> None:
        if not self._deferred:
            os._exit(0)
        self.requested = True
