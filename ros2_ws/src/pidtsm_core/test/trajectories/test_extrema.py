"""Extrema of polynomials."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pidtsm_core.trajectories.extrema import DEPTH, maximum

COEFFICIENTS = st.lists(st.floats(-10.0, 10.0), min_size=6, max_size=6)


@given(powers=COEFFICIENTS, sign=st.sampled_from([-1.0, 1.0]))
def test_the_maximum_is_that_of_a_fine_grid(powers: list[float], sign: float) -> None:
    x = np.linspace(0.0, 1.0, 20001)
    values = sign * np.polynomial.polynomial.polyval(x, powers)
    found, place = maximum(np.array(powers), sign, -1e3, np.empty((DEPTH, 8)))
    assert values.max() - 1e-9 <= found <= values.max() + 1e-5
    assert abs(sign * np.polynomial.polynomial.polyval(place, powers) - found) < 1e-9


@given(powers=COEFFICIENTS)
def test_a_maximum_below_the_bound_is_not_looked_for(powers: list[float]) -> None:
    assert maximum(np.array(powers), 1.0, 100.0, np.empty((DEPTH, 8))) == (100.0, -1.0)
