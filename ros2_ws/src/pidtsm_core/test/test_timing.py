"""Integer nanoseconds and their one conversion to seconds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pidtsm_core.compiling.decorators import njit
from pidtsm_core.timing import period_nanoseconds, seconds


@njit
def compiled_seconds(nanoseconds: int) -> float:
    return seconds(nanoseconds)


@pytest.mark.parametrize(
    ("rate", "period"), [(1, 1_000_000_000), (1000, 1_000_000), (3, 333_333_333), (100_000, 10_000)]
)
def test_period_of_a_rate(rate: int, period: int) -> None:
    assert period_nanoseconds(rate) == period


@settings(deadline=None, max_examples=100)
@given(st.integers(min_value=-(10**18), max_value=10**18))
def test_seconds_are_correctly_rounded_alike_for_numbers_arrays_and_compiled_code(nanoseconds: int) -> None:
    # Python divides integers with one correct rounding; 10**18 needs more bits than a float has.
    assert seconds(nanoseconds) == float(nanoseconds) / 1e9
    assert (np.array([nanoseconds]) / 1e9)[0] == seconds(nanoseconds)
    assert compiled_seconds(nanoseconds) == seconds(nanoseconds)


def test_a_whole_millisecond_is_the_nearest_float() -> None:
    assert [seconds(k * 1_000_000) for k in range(30_000)] == [k / 1000 for k in range(30_000)]
