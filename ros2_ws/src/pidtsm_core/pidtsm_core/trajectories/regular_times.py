"""Times of messages without stamps."""

from pidtsm_core.timing import NANOSECONDS

_SHORTEST = NANOSECONDS // 1000
"""Shortest period, ns."""


class RegularTimes:
    """Gives messages without stamps the times at which a regular sender would have sent them: a phase-locked loop."""

    _TIME, _LARGEST_SHARE = 0.15 * NANOSECONDS, 0.3
    """Time in which the loop corrects its phase (critically damped), ns; largest share of a deviation it corrects."""
    _FARTHEST = 0.05 * NANOSECONDS
    """Largest distance from the time of arrival, ns; in a shorter gap no message is missing, but some are late."""

    def __init__(self) -> None:
        self._last = self._period = 0.0  # ns

    def stamp(self, now: int) -> int:
        """Stamp of the next message, which arrives at `now`, ns."""
        since = now - self._last
        if not self._last or since > NANOSECONDS:
            self._last, self._period = float(now), 0.0
            return now
        if not self._period:
            self._period = max(since, _SHORTEST)
        count = max(round(since / self._period), 1) if since > self._FARTHEST else 1
        deviation = since - count * self._period
        share = min(self._period / self._TIME, self._LARGEST_SHARE)
        last = self._last + max(count * self._period + share * deviation, 0.1 * self._period)
        self._last = min(max(last, now - self._FARTHEST), now + self._FARTHEST)
        self._period = max(self._period + 0.5 * share * share * deviation / count, _SHORTEST)
        return round(self._last)
