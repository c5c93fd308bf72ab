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
