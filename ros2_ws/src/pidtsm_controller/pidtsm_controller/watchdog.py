"""Detection of missing joint states."""

import time

from pidtsm_core.timing import NANOSECONDS

CHECK = 0.005
"""Time between two checks, s."""


class Watchdog:
    """Measures the silence since the last joint state, ns of the monotonic clock."""

    def __init__(self) -> None:
        self._received = self._checked = self._attentive_since = 0

    def received(self) -> None:
        """Note that a joint state was handled just now."""
        self._received = time.monotonic_ns()

    @property
    def age(self) -> int:
        """Time since the last joint state, ns."""
        return time.monotonic_ns() - self._received

    def silence(self) -> int:
        """Time without a joint state while this process could have received one, ns; call it every `CHECK`.

        If this process was suspended, messages that arrived meanwhile are handled only after this check.
        """
        now = time.monotonic_ns()
        if now - self._checked > 2 * CHECK * NANOSECONDS:
            self._attentive_since = now
        self._checked = now
        return now - max(self._received, self._attentive_since)
