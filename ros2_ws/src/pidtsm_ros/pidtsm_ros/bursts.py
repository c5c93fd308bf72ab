"""Frequent events, up to a thousand per second, that are logged once per burst."""

import math
import time

QUIET = 1.0
"""After this time without an event, the next event begins a new burst, s."""


class Bursts:
    """Counts events and detects the first of each burst.

    Attributes:
        count: events so far.
    """

    def __init__(self) -> None:
        self.count = 0
        self._last = -math.inf

    def begins(self) -> bool:
        """Count one more event; returns whether it is the first after at least `QUIET` s."""
        self.count += 1
        now = time.monotonic()
        begins = now - self._last > QUIET
        self._last = now
        return begins
