"""Time as integer nanoseconds, and its one conversion to seconds (nodes and rollout must agree to the last bit)."""

from pidtsm_core.compiled import inlined

NANOSECONDS = 1_000_000_000


def period_nanoseconds(rate: int) -> int:
    """Sampling period in ns of a rate in Hz."""
    return NANOSECONDS // rate


@inlined
def seconds(nanoseconds: int) -> float:
    """Nanoseconds as s; one correctly rounded division."""
    return nanoseconds / 1e9


def sum_of_times(*times: float) -> float:
    """The sum of times in s, to the nanosecond, as the time of a sample is: else 0.1 s + 0.2 s ends a sample late."""
    return seconds(round(sum(times) * 1e9))


@inlined
def track_period(period: int, elapsed: int) -> int:
    """The nominal period of samples (ns) after one more, `elapsed` ns after the one before: nearly the median.

    It moves by a few per cent a sample at most, so that gaps and jitter leave it alone.

    Args:
        period: nominal period so far; 0: not known.
        elapsed: positive.
    """
    if period == 0:
        return elapsed
    return period + min(max(elapsed - period, -(period // 32)), period // 32)
