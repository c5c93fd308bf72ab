"""Time as integer nanoseconds, and its one conversion to seconds (nodes and rollout must agree to the last bit)."""

from typing import TypeVar

from pidtsm_core.compiled import njit

NANOSECONDS = 1_000_000_000

_T = TypeVar("_T")


def period_nanoseconds(rate: int) -> int:
    """Sampling period in ns of a rate in Hz."""
    return NANOSECONDS // rate


@njit
def seconds(nanoseconds: _T) -> float:
    """Nanoseconds as s; one correctly rounded division."""
    return nanoseconds / 1e9  # type: ignore[no-any-return, operator]
