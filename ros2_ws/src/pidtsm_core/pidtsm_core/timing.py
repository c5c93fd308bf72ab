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
