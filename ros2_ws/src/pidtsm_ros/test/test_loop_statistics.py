"""The statistics of a loop match its ticks."""

import numpy as np
import pytest

from pidtsm_ros.loop_statistics import LoopStatistics, Window

MS = 1_000_000


def test_a_window_is_summed_up_after_a_second() -> None:
    rng = np.random.default_rng(1)
    periods = rng.integers(800_000, 1_200_000, size=2500)
    periods[[300, 1700]] = 5 * MS
    ages = rng.random(periods.size) * 1e-3
    statistics = LoopStatistics(0.002)
    now = 7 * MS
    statistics.tick(now, 1.0, 1.0)
    assert (statistics.period, statistics.missed) == (0.0, 0)
    for k, period in enumerate(periods.tolist()):
        now += period
        statistics.tick(now, float(ages[k]), 2e-5)
        assert statistics.period == pytest.approx(period / 1e9)
    ends = np.flatnonzero(np.diff(np.cumsum(periods) // 1_000_000_000, prepend=0))
    assert statistics.missed == 2
    assert len(ends) == 2
    first = ends[0] + 1
    window = statistics.last
    # The second window begins where the first ended, at its last tick.
    length = np.searchsorted(np.cumsum(periods[first:]), 1_000_000_000) + 1
    seen = periods[first : first + length] / 1e9
    assert window.ticks == length
    assert window.rate == pytest.approx(1 / seen.mean())
    assert window.jitter == pytest.approx(seen.std(), rel=1e-6)
    assert window.longest_period == pytest.approx(0.005)
    assert window.missed == 1
    assert window.longest_age == pytest.approx(ages[first : first + length].max())
    assert window.longest_compute_time == 2e-5


def test_reset_forgets() -> None:
    statistics = LoopStatistics(0.002)
    for now in (0, 1, 2, 602, 1202):
        statistics.tick(now * MS, 0.0, 0.0)
    assert statistics.missed == 2
    assert statistics.last.ticks == 4
    statistics.reset()
    assert (statistics.missed, statistics.period, statistics.last) == (0, 0.0, Window())


@pytest.mark.parametrize(("rate", "scale"), [(100, 10.0), (250, 4.0), (700, 1000 / 700), (1000, 1.0), (2000, 1.0)])
def test_a_slower_loop_has_longer_deadlines(rate: int, scale: float) -> None:
    statistics, random, now = LoopStatistics(0.002), np.random.default_rng(1), 0
    for k in range(2 * rate):
        # Jitter, and two periods that are too long.
        now += round(1000 * MS / rate * random.uniform(0.6, 1.4) * (5.0 if k in (50, 90) else 1.0))
        statistics.tick(now, 0.0, 0.0)
    assert statistics.scale == pytest.approx(scale, rel=0.15)
    assert statistics.missed == 2
