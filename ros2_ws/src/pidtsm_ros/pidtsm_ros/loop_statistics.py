"""Timing statistics of a loop: cheap counters at every tick, summarised once per second."""

import math
from dataclasses import dataclass

from pidtsm_core.timing import NANOSECONDS, track_period

_FASTEST = NANOSECONDS // 1000
"""Time limits apply as given to loops of this period or faster, and grow with the period of slower loops; ns."""


@dataclass(frozen=True)
class Window:
    """The ticks of about one second.

    Attributes:
        ticks: number of ticks.
        rate: ticks per second, 1/s.
        jitter: standard deviation of the period, s.
        longest_period: s.
        missed: number of periods longer than the deadline.
        longest_compute_time, longest_age: s.
    """

    ticks: int = 0
    rate: float = 0.0
    jitter: float = 0.0
    longest_period: float = 0.0
    missed: int = 0
    longest_compute_time: float = 0.0
    longest_age: float = 0.0


class LoopStatistics:
    """Counts the ticks of a loop.

    Attributes:
        deadline: a longer period counts as a missed deadline; s at 1 kHz, see `scale`.
        period: the last period, s; 0 before the second tick.
        missed: missed deadlines since the start.
        last: the last complete window.
    """

    def __init__(self, deadline: float) -> None:
        """Args: deadline: as the attribute."""
        self.deadline = deadline
        self.reset()

    def reset(self) -> None:
        """Discard all counts."""
        self.period = 0.0
        self.missed = 0
        self.last = Window()
        self._last_tick = -1
        self._nominal = 0
        self._began = -1
        self._clear()

    @property
    def scale(self) -> float:
        """Factor for time limits at the measured nominal period of the loop; at least 1."""
        return max(1.0, self._nominal / _FASTEST)

    def _clear(self) -> None:
        self._periods = 0
        self._sum = self._squares = self._longest_period = self._longest_compute = self._longest_age = 0.0
        self._missed_before = self.missed

    def tick(self, now: int, age: float, compute_time: float) -> None:
        """Count one tick.

        Args:
            now: monotonic clock, ns.
            age: age of the tick's input, s.
            compute_time: s.
        """
        last, self._last_tick = self._last_tick, now
        if last < 0:
            self._began = now
            return
        self._nominal = track_period(self._nominal, now - last)
        period = self.period = (now - last) * 1e-9
        self._periods += 1
        self._sum += period
        self._squares += period * period
        if period > self._longest_period:
            self._longest_period = period
        if period > self.deadline and period > self.deadline * self.scale:
            self.missed += 1
        if age > self._longest_age:
            self._longest_age = age
        if compute_time > self._longest_compute:
            self._longest_compute = compute_time
        if now - self._began >= NANOSECONDS:
            self._close(now)

    def _close(self, now: int) -> None:
        n = self._periods
        mean = self._sum / n
        self.last = Window(
            ticks=n,
            rate=1.0 / mean,
            jitter=math.sqrt(max(0.0, self._squares / n - mean * mean)),
            longest_period=self._longest_period,
            missed=self.missed - self._missed_before,
            longest_compute_time=self._longest_compute,
            longest_age=self._longest_age,
        )
        self._began = now
        self._clear()
