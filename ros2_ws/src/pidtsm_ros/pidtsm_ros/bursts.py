"""Events that may come a thousand times a second, and deserve a line of the log each time they begin."""

import math
import time

QUIET = 1.0
"""s without an event after which the next one begins a burst."""


class Bursts:
    """Counts events, and says which of them begins a burst.

    Attributes:
        count: events so far.
    """

    def __init__(self) -> None:
        self.count = 0
        self._last = -math.inf

    def begins(self) -> bool:
        """Count one more event; whether none came for `QUIET` s before it."""
        self.count += 1
        now = time.monotonic()
        begins = now - self._last > QUIET
        self._last = now
        return begins
