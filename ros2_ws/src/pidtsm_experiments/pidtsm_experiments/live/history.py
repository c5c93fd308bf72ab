"""What a page remembers of the samples: curves of the last seconds, and the metrics since a mark."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pidtsm_core.arrays import Array

SPAN = 20.0
"""Length of the curves, s."""
_BUCKET = 50_000_000
"""Time of which a curve keeps the smallest and the largest value, ns."""
_BUCKETS = round(SPAN * 1e9 / _BUCKET)


class Curves(NamedTuple):
    """Curves over time, from which no peak is missing."""

    time: Array  # shape (points,), s from the first sample of the history
    values: Array  # shape (points, signals, joints)


class History:
    """The last `SPAN` of some signals, decimated: two points for each 50 ms, so its size is bounded."""

    def __init__(self, keep_first: bool = False) -> None:
        """Args: keep_first: keep the first `SPAN` instead of the last."""
        self._keep_first = keep_first
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._done: deque[tuple[int, Array, Array]] = deque(maxlen=_BUCKETS)
        self._open: tuple[int, Array, Array] | None = None
        self._first: int | None = None

    @property
    def begin(self) -> int | None:
        """Stamp of the first sample, ns; None: there is none."""
        return self._first

    def add(self, stamps: NDArray[np.int64], values: Array) -> None:
        """Add samples; if their stamps are older than those before, the clock was set, and everything else is dropped.

        Args:
            stamps: shape (samples,), ns.
            values: shape (samples, signals, joints).
        """
        buckets = stamps // _BUCKET
        if self._open is not None and (buckets[0] < self._open[0] or values.shape[1:] != self._open[1].shape):
            self.clear()
        if self._first is None:
            self._first = int(stamps[0])
        for bucket in np.unique(buckets):
            inside = values[buckets == bucket]
            low, high = inside.min(axis=0), inside.max(axis=0)
            if self._open is not None and self._open[0] == bucket:
                low, high = np.minimum(low, self._open[1]), np.maximum(high, self._open[2])
            elif self._open is not None and not (self._keep_first and len(self._done) == _BUCKETS):
                self._done.append(self._open)
            self._open = int(bucket), low, high

    def curves(self) -> Curves:
        """The curves so far; empty if there is less than 50 ms."""
        if not self._done:
            return Curves(np.zeros(0), np.zeros((0, 0, 0)))
        buckets, low, high = zip(*self._done, strict=True)
        assert self._first is not None
        begin = np.array(buckets, dtype=np.int64) * _BUCKET - self._first
        time = np.stack([begin, begin + _BUCKET // 2], axis=1).reshape(-1) * 1e-9
        values = np.stack([low, high], axis=1).reshape(-1, *low[0].shape)
        return Curves(np.asarray(time, dtype=np.float64), values)


class Measurement:
    """RMSE and ECI of every sample since a mark, and the error since then, for at most `SPAN`."""

    def __init__(self) -> None:
        self.samples = 0
        self._squares: Array = np.zeros(0)
        self._efforts: Array = np.zeros(0)
        self._error = History(keep_first=True)

    def add(self, stamps: NDArray[np.int64], error: Array, effort: Array) -> None:
        """Add samples.

        Args:
            stamps: shape (samples,), ns.
            error: e, shape (samples, joints), rad or m.
            effort: commanded effort, likewise, N m or N.
        """
        if self.samples == 0 or error.shape[1:] != self._squares.shape:
            self.samples, self._squares, self._efforts = 0, np.zeros(error.shape[1]), np.zeros(error.shape[1])
        self.samples += len(stamps)
        self._squares = self._squares + np.square(error).sum(axis=0)
        self._efforts = self._efforts + np.abs(effort).sum(axis=0)
        self._error.add(stamps, error[:, np.newaxis])

    @property
    def rmse(self) -> Array:
        """sqrt(mean(e^2)), eq. (53), shape (joints,), rad or m; empty without samples."""
        return np.sqrt(self._squares / max(self.samples, 1))

    @property
    def eci(self) -> Array:
        """mean |tau|, eq. (54), shape (joints,), N m or N; empty without samples."""
        return self._efforts / max(self.samples, 1)

    def error(self) -> Curves:
        """The error since the mark, one signal."""
        return self._error.curves()
