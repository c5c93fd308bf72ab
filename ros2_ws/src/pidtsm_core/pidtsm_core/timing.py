"""Time as integer nanoseconds, and its only conversion to seconds (nodes and rollout must agree to the last bit)."""

from pidtsm_core.compiling.decorators import inlined

NANOSECONDS = 1_000_000_000
LONGEST_RUN = 1e9
"""Longest duration of a run, s; its end must be a number of nanoseconds of 64 bits."""


def period_nanoseconds(rate: int) -> int:
    """Sampling period in ns for a rate in Hz."""
    return NANOSECONDS // rate


@inlined
def seconds(nanoseconds: int) -> float:
    """Convert ns to s with a single, correctly rounded division."""
    return nanoseconds / 1e9


def sum_of_times(*times: float) -> float:
    """Sum of times in s, rounded to 1 ns like the times of samples; otherwise 0.1 s + 0.2 s ends one sample late."""
    return seconds(round(sum(times) * 1e9))


@inlined
def track_period(period: int, elapsed: int) -> int:
    """Update the nominal period of samples (ns), approximately the median of the periods.

    It changes by at most a few per cent per sample, so gaps and jitter hardly affect it.

    Args:
        period: nominal period so far, ns; 0: unknown.
        elapsed: time between the last two samples, ns, positive.
    """
    if period == 0:
        return elapsed
    return period + min(max(elapsed - period, -(period // 32)), period // 32)
